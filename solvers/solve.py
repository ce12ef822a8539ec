"""Solve a document: the only place that chooses a method."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from solvers.bases.graded import GradedKnots
from solvers.certificate import hamiltonian_drift
from solvers.diagnosis import find_evaluation_fault
from solvers.errors import DocumentError, Fault
from solvers.guess import Start, WarmStart
from solvers.optimizers.ipopt import Limits
from solvers.problem import OptimalControlProblem
from solvers.progress import Progress, ProgressReport, SilentProgress
from solvers.refine.adaptive import AdaptiveMesh, adapt
from solvers.refine.adaptive_gauss import GaussMesh
from solvers.refine.adaptive_intervals import IntervalMesh
from solvers.refine.adaptive_splines import SplineMesh
from solvers.refine.residual import mesh_error_estimate
from solvers.refine.switching import refine_switching
from solvers.report import constraint_margins
from solvers.scaling import Scaling, automatic_scaling
from solvers.session import Session, Solved
from solvers.solution import Solution, Statistics
from solvers.spec import (
    AutoMethod,
    GaussPseudospectralMethod,
    HermiteSimpsonMethod,
    JobSpec,
    Method,
    SplineAdaptivity,
    SplineWaveletMethod,
)
from solvers.starts import several_starts
from solvers.status import SolveStatus
from solvers.switching import find_switching
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription
from solvers.transcription.gauss_pseudospectral import GaussPseudospectral
from solvers.transcription.hermite_simpson import HermiteSimpson
from solvers.transcription.spline_wavelet import SplineWavelet
from solvers.verify import Tolerances, Verification, verify

Mesh = Callable[[OptimalControlProblem, Scaling, Start], Transcription]

# Levels between two solves of the continuation: a start four levels coarser costs little and saves half the
# iterations of a fine level (docs/benchmarks.md).
_LEVEL_STRIDE = 4
_COARSEST_LEVEL = 1
_VERIFY_SECONDS = 60.0
_VERIFY_SECONDS_UNCONVERGED = 2.0
_VERIFY_SECONDS_CANCELLED = 0.5


def solve(spec: JobSpec, progress: Progress | None = None, earlier: Trajectory | None = None) -> Solution:
    """Solve a checked document and verify the answer.

    ``earlier`` is the answer of the job that the document names in ``warm_start``. Never raises for a
    numerical failure: the last iterate comes back with its status. Raises DocumentError if ``warm_start`` is
    given without ``earlier``, and what ``progress`` raises.
    """
    if spec.warm_start is not None and earlier is None:
        detail = "there is no earlier job to start from here; guess.from_result takes the nodes of a result"
        raise DocumentError([Fault("/warm_start", detail)])
    started = time.perf_counter()
    problem = OptimalControlProblem.from_spec(spec.problem)
    progress = progress or SilentProgress()
    session = Session(
        problem,
        automatic_scaling(problem),
        spec.options.tolerance,
        spec.options.max_iterations,
        Limits(time.monotonic() + spec.options.max_seconds, progress.cancelled),
        progress,
    )
    session.seconds["build"] = time.perf_counter() - started
    method, meshes = _meshes(spec)
    span = 1.0 if spec.method.refinement is None and spec.method.adaptivity is None else 0.5
    answers = _warm_answer(session, meshes, earlier, span) or _answers(
        session, meshes, spec.options.starts, span
    )
    best = solved = min(answers, key=_rank)
    unreached = None
    if spec.method.adaptivity is not None and solved.converged:
        adapted = adapt(session, _adaptive_mesh(spec.method), spec.method.adaptivity.tolerance, solved, span)
        solved, unreached = adapted.solved, adapted.reason
        method = {**method, "adaptive": {**spec.method.adaptivity.model_dump(), **adapted.mesh.summary}}
    refinement = None
    if spec.method.refinement is not None and solved.converged:
        refinement = refine_switching(session, solved)
        solved = refinement.solved
    costates = solved.transcription.costates(solved.trajectory, solved.outcome.row_multipliers)
    verification = replace(
        _verify(session, spec, solved),
        hamiltonian_drift=hamiltonian_drift(problem, solved.trajectory, costates),
        mesh_error_estimate=mesh_error_estimate(problem, solved.trajectory),
    )
    switching, warnings = find_switching(problem, solved.trajectory), list[dict[str, str]]()
    if refinement is not None:
        verification = refinement.certified(problem, verification)
        switching, warnings = refinement.switching(problem), refinement.warnings
        method = {**method, **refinement.summary}
    if unreached is not None and (refinement is None or refinement.refined is None):
        warnings.append({"code": "tolerance_not_reached", "pointer": "/method/adaptive", "detail": unreached})
    status, message = _judge(spec, session, solved, verification)
    message = " ".join([message, *(item["detail"] for item in warnings)])
    session.seconds["total"] = time.perf_counter() - started
    return Solution(
        spec=spec,
        problem=problem,
        trajectory=solved.trajectory,
        costates=costates,
        objective=solved.objective,
        status=status,
        message=message,
        method=method,
        verification=verification,
        switching=switching,
        constraints=constraint_margins(problem, solved.trajectory),
        convergence=session.convergence,
        starts=[
            {
                "objective": answer.objective,
                "final_time": answer.trajectory.tf,
                "status": answer.outcome.status.value,
                "kept": answer is best,
            }
            for answer in answers
        ],
        warnings=warnings,
        statistics=Statistics(
            solved.transcription.builder.size,
            solved.transcription.builder.row_count,
            session.iterations,
            solved.outcome.solver_status,
            session.seconds,
        ),
    )


def _warm_answer(
    session: Session, meshes: Sequence[Mesh], earlier: Trajectory | None, span: float
) -> list[Solved]:
    """The finest mesh solved from an earlier answer; nothing if there is none or it leads nowhere."""
    if earlier is None:
        return []
    problem = session.problem
    start = WarmStart(earlier, problem.guess, problem.states, problem.controls)
    transcription = meshes[-1](problem, session.scaling, start)
    solved = session.solve(transcription, "solve from the earlier job", (0.0, span), warm=True)
    return [solved] if solved.converged or solved.stopped else []


def _answers(session: Session, meshes: Sequence[Mesh], count: int, span: float) -> list[Solved]:
    """An answer from each start, ``span`` of all work; fewer if somebody or the clock asks to stop."""
    answers: list[Solved] = []
    for index, start in enumerate(several_starts(session.problem, session.scaling, count)):
        stage = "solve" if count == 1 else f"start {index + 1} of {count}"
        share = span * index / count, span * (index + 1) / count
        answers.append(_continue(session, meshes, start, stage, share))
        if answers[-1].stopped:
            break
    return answers


def _rank(answer: Solved) -> tuple[bool, float]:
    """Converged answers first, then the smallest objective."""
    return not answer.converged, answer.objective if np.isfinite(answer.objective) else np.inf


def _continue(
    session: Session, meshes: Sequence[Mesh], first: Start, stage: str, share: tuple[float, float]
) -> Solved:
    """Solve mesh after mesh, each from the answer of the one before."""
    start, width = first, (share[1] - share[0]) / len(meshes)
    for index, mesh in enumerate(meshes):
        label = stage if len(meshes) == 1 else f"{stage} level {index + 1} of {len(meshes)}"
        part = share[0] + index * width, share[0] + (index + 1) * width
        transcription = mesh(session.problem, session.scaling, start)
        solved = session.solve(transcription, label, part, warm=start is not first)
        if solved.stopped:
            break
        # Building a fine mesh takes its time: ask before.
        stop = session.stop if index + 1 < len(meshes) else None
        if stop is not None:
            return replace(solved, outcome=replace(solved.outcome, status=stop))
        # A coarse mesh that does not converge says nothing about the next one: start that like the first.
        start = solved.trajectory if solved.converged else first
    return solved


def _verify(session: Session, spec: JobSpec, solved: Solved) -> Verification:
    started = time.perf_counter()
    session.progress.report(ProgressReport("verify", session.iterations, fraction=1.0))
    patience = _VERIFY_SECONDS if solved.converged else _VERIFY_SECONDS_UNCONVERGED
    if solved.outcome.status is SolveStatus.CANCELLED:
        patience = _VERIFY_SECONDS_CANCELLED
    tolerances = Tolerances(**spec.verification_tolerances())
    verification = verify(session.problem, solved.trajectory, tolerances, time.monotonic() + patience)
    session.convergence[-1]["max_state_error"] = verification.max_state_error
    session.seconds["verify"] = time.perf_counter() - started
    return verification


def _judge(
    spec: JobSpec, session: Session, solved: Solved, verification: Verification
) -> tuple[SolveStatus, str]:
    """The status of the result, and a message with what decided and what to try."""
    status = solved.outcome.status
    if status in (SolveStatus.EVALUATION_ERROR, SolveStatus.DIVERGED):
        fault = find_evaluation_fault(spec.problem, session.problem, solved.trajectory)
        if fault is not None:
            status = SolveStatus.EVALUATION_ERROR
            return status, f"{status.sentence} {fault.pointer}: {fault.detail}"
    if status is SolveStatus.CONVERGED and not verification.passed:
        status = SolveStatus.UNVERIFIED
    details = [status.sentence]
    if status is SolveStatus.UNVERIFIED:
        failed = [check for check in verification.checks if not check.passed]
        details += [f"{check.name} is {check.value}, the limit {check.limit}." for check in failed]
    if verification.note:
        details.append(verification.note)
    return status, " ".join(details)


def _meshes(spec: JobSpec) -> tuple[Mapping[str, Any], Sequence[Mesh]]:
    """What was done, as the ``method`` of the result, and the meshes from coarse to fine."""
    method = SplineWaveletMethod(name="swcm") if isinstance(spec.method, AutoMethod) else spec.method
    match method:
        case SplineWaveletMethod(L=length, first_level=finest):
            levels = sorted({finest, *range(finest - _LEVEL_STRIDE, _COARSEST_LEVEL - 1, -_LEVEL_STRIDE)})
            adapts = method.adaptive is not None
            return {"name": "swcm", "L": length, "J": finest}, [
                lambda p, s, start, J=level: SplineWavelet(
                    p, s, start, GradedKnots.uniform(length, J), adaptive=adapts
                )
                for level in levels
            ]
        case GaussPseudospectralMethod(nodes=nodes, segments=segments):
            breaks = np.linspace(0.0, 1.0, segments + 1)
            return {"name": "gpm", "nodes": nodes, "segments": segments}, [
                lambda p, s, start: GaussPseudospectral(p, s, start, breaks, (nodes,) * segments)
            ]
        case HermiteSimpsonMethod(intervals=intervals):
            knots = np.linspace(0.0, 1.0, intervals + 1)
            return {"name": "hermite_simpson", "intervals": intervals}, [
                lambda p, s, start: HermiteSimpson(p, s, start, knots)
            ]
    raise TypeError(f"no transcription for the method {method!r}")


def _adaptive_mesh(method: Method) -> AdaptiveMesh:
    """The finest mesh of :func:`_meshes`, as one that knows how to become a better one."""
    match method:
        case SplineWaveletMethod(L=length, first_level=level, adaptive=SplineAdaptivity(max_level=highest)):
            return SplineMesh(GradedKnots.uniform(length, level), highest)
        case GaussPseudospectralMethod(nodes=nodes, segments=segments):
            return GaussMesh(np.linspace(0.0, 1.0, segments + 1), (nodes,) * segments)
        case HermiteSimpsonMethod(intervals=intervals):
            return IntervalMesh(np.linspace(0.0, 1.0, intervals + 1))
    raise TypeError(f"no adaptive mesh for the method {method!r}")
