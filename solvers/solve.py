"""Solve a document: first answer, improvement, verification, judgement."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

from solvers.certificate import hamiltonian_drift
from solvers.diagnosis import find_evaluation_fault
from solvers.errors import DocumentError, Fault
from solvers.first_answer import first_answers
from solvers.improve import first_method, improve, wants_more
from solvers.meshes import meshes_of
from solvers.model_report import model_report
from solvers.optimizers.ipopt import Limits
from solvers.piecewise.solve import solve_piecewise
from solvers.problem import OptimalControlProblem
from solvers.progress import Progress, ProgressReport, SilentProgress
from solvers.refine.residual import mesh_error_estimate
from solvers.report import constraint_margins
from solvers.scaling import automatic_scaling
from solvers.session import Session, Solved
from solvers.solution import Solution, Statistics
from solvers.spec import JobSpec, PiecewiseMethod
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.verify import Tolerances, Verification, verify

# The part of all work that a first answer is taken to be where more is asked for.
_FIRST_SPAN = 0.5
_VERIFY_SECONDS = 60.0
_VERIFY_SECONDS_UNCONVERGED = 2.0
_VERIFY_SECONDS_CANCELLED = 0.5


def solve(
    spec: JobSpec,
    progress: Progress | None = None,
    earlier: Trajectory | None = None,
    seconds: float = math.inf,
) -> Solution:
    """Solve a checked document and verify the answer.

    ``earlier`` is the answer of the job that the document names in ``warm_start``; ``seconds`` is the time
    there is, where that is less than the document's ``max_seconds``. Never raises for a
    numerical failure: the last iterate comes back with its status. Raises DocumentError if ``warm_start`` is
    given without ``earlier``, and what ``progress`` raises.
    """
    if spec.warm_start is not None and earlier is None:
        detail = "there is no earlier job to start from here; guess.from_result takes the nodes of a result"
        raise DocumentError([Fault("/warm_start", detail)])
    if isinstance(spec.method, PiecewiseMethod):
        return solve_piecewise(spec, progress or SilentProgress(), min(spec.options.max_seconds, seconds))
    started = time.perf_counter()
    session = _session(spec, progress or SilentProgress(), min(spec.options.max_seconds, seconds))
    session.seconds["build"] = time.perf_counter() - started
    problem, method = session.problem, first_method(spec.method)
    span = _FIRST_SPAN if wants_more(spec.method) else 1.0
    answers = first_answers(session, meshes_of(method), spec.options.starts, earlier, span)
    improved = improve(session, spec.method, answers[0], span)
    solved = improved.solved
    costates = solved.transcription.costates(solved.trajectory, solved.outcome.row_multipliers)
    verification = replace(
        _verify(session, spec, solved),
        hamiltonian_drift=hamiltonian_drift(solved.weighted_problem, solved.trajectory, costates),
        mesh_error_estimate=mesh_error_estimate(problem, solved.trajectory),
    )
    verification = improved.certified(problem, verification)
    status, message = _judge(spec, session, solved, verification)
    session.seconds["total"] = time.perf_counter() - started
    return Solution(
        spec=spec,
        problem=problem,
        trajectory=solved.trajectory,
        costates=costates,
        objective=solved.objective,
        status=status,
        message=" ".join([message, *(item["detail"] for item in improved.warnings)]),
        method={**method.model_dump(exclude_none=True), **improved.summary},
        verification=verification,
        model_report=model_report(problem, solved.trajectory),
        integrals=solved.transcription.integrals(solved.outcome.unknowns),
        switching=improved.switching(problem),
        constraints=constraint_margins(problem, solved.trajectory),
        convergence=session.convergence,
        starts=[_start_report(answer, kept=answer is answers[0]) for answer in answers],
        warnings=improved.warnings,
        statistics=Statistics(
            solved.transcription.builder.size,
            solved.transcription.builder.row_count,
            session.iterations,
            solved.outcome.solver_status,
            session.seconds,
        ),
    )


def _session(spec: JobSpec, progress: Progress, seconds: float) -> Session:
    problem = OptimalControlProblem.from_spec(spec.problem)
    return Session(
        problem,
        automatic_scaling(problem),
        spec.options.tolerance,
        spec.options.max_iterations,
        Limits(time.monotonic() + seconds, progress.cancelled),
        progress,
    )


def _start_report(answer: Solved, *, kept: bool) -> dict[str, Any]:
    return {
        "objective": answer.objective,
        "final_time": answer.trajectory.tf,
        "status": answer.outcome.status.value,
        "kept": kept,
    }


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
