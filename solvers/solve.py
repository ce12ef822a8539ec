"""Solve a document: the only place that chooses a method."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from solvers.diagnosis import find_evaluation_error
from solvers.guess import Start
from solvers.optimizers.ipopt import Iterate, Limits, Outcome, minimise
from solvers.problem import OptimalControlProblem
from solvers.progress import Progress, ProgressReport, SilentProgress
from solvers.report import constraint_margins
from solvers.scaling import Scaling, automatic_scaling
from solvers.solution import Solution, Statistics
from solvers.spec import (
    AutoMethod,
    GaussPseudospectralMethod,
    HermiteSimpsonMethod,
    JobSpec,
    SplineWaveletMethod,
)
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


def solve(spec: JobSpec, progress: Progress | None = None) -> Solution:
    """Solve a checked document and verify the answer.

    Never raises for a numerical failure: the last iterate comes back with its status. Raises what
    ``progress`` raises.
    """
    run = _Run(spec, progress or SilentProgress())
    return run.solution()


@dataclass
class _Run:
    spec: JobSpec
    progress: Progress
    convergence: list[dict[str, Any]] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0, "solve": 0.0, "refine": 0.0})
    iterations: int = 0

    def solution(self) -> Solution:
        started = time.perf_counter()
        spec = self.spec
        self.problem = OptimalControlProblem.from_spec(spec.problem)
        self.limits = Limits(
            tolerance=spec.options.tolerance,
            max_iterations=spec.options.max_iterations,
            deadline=time.monotonic() + spec.options.max_seconds,
            cancelled=self.progress.cancelled,
        )
        method, meshes = _meshes(spec)
        self.seconds["build"] = time.perf_counter() - started
        transcription, outcome = self._optimise(meshes)
        trajectory = transcription.trajectory(outcome.unknowns)
        verification = self._verify(trajectory, outcome.status)
        status, message = self._judge(trajectory, outcome, verification)
        self.convergence[-1]["max_state_error"] = verification.max_state_error
        self.seconds["total"] = time.perf_counter() - started
        program = transcription.builder
        return Solution(
            spec=spec,
            problem=self.problem,
            trajectory=trajectory,
            objective=outcome.objective * transcription.scaling.objective,
            status=status,
            message=message,
            method=method,
            verification=verification,
            switching=find_switching(self.problem, trajectory),
            constraints=constraint_margins(self.problem, trajectory),
            convergence=self.convergence,
            warnings=[],
            statistics=Statistics(
                program.size, program.row_count, self.iterations, outcome.solver_status, self.seconds
            ),
        )

    def _optimise(self, meshes: Sequence[Mesh]) -> tuple[Transcription, Outcome]:
        """Solve mesh after mesh, each from the answer of the one before."""
        scaling = automatic_scaling(self.problem)
        start: Start = self.problem.guess
        for index, mesh in enumerate(meshes):
            transcription = mesh(self.problem, scaling, start)
            outcome = self._minimise(transcription, index, len(meshes), warm=start is not self.problem.guess)
            if outcome.status in (SolveStatus.CANCELLED, SolveStatus.TIME_LIMIT):
                break
            # A coarse mesh that does not converge says nothing about the next one: start that from the guess.
            converged = outcome.status is SolveStatus.CONVERGED
            start = transcription.trajectory(outcome.unknowns) if converged else self.problem.guess
        return transcription, outcome

    def _minimise(self, transcription: Transcription, index: int, count: int, *, warm: bool) -> Outcome:
        started = time.perf_counter()
        stage = "solve" if count == 1 else f"solve level {index + 1} of {count}"

        def report(iterate: Iterate) -> None:
            self.progress.report(
                ProgressReport(
                    stage,
                    iterate.iteration,
                    iterate.objective * transcription.scaling.objective,
                    iterate.infeasibility,
                    (index + iterate.iteration / (iterate.iteration + 30.0)) / count,
                )
            )

        program = transcription.program()
        outcome = minimise(program, self.limits, report, warm=warm)
        self.iterations += outcome.iterations
        self.seconds["build"] += time.perf_counter() - started - outcome.solve_seconds
        self.seconds["solve"] += outcome.solve_seconds
        self.convergence.append(
            {
                "level": index,
                "nodes": transcription.nodes().tau.size,
                "objective": outcome.objective * transcription.scaling.objective,
                "max_state_error": None,
            }
        )
        return outcome

    def _verify(self, trajectory: Trajectory, status: SolveStatus) -> Verification:
        started = time.perf_counter()
        self.progress.report(ProgressReport("verify", self.iterations, fraction=1.0))
        tolerances = Tolerances(**self.spec.verification_tolerances())
        patience = _VERIFY_SECONDS if status is SolveStatus.CONVERGED else _VERIFY_SECONDS_UNCONVERGED
        verification = verify(self.problem, trajectory, tolerances, time.monotonic() + patience)
        self.seconds["verify"] = time.perf_counter() - started
        return verification

    def _judge(
        self, trajectory: Trajectory, outcome: Outcome, verification: Verification
    ) -> tuple[SolveStatus, str]:
        status = outcome.status
        if status is SolveStatus.CONVERGED and not verification.passed:
            status = SolveStatus.UNVERIFIED
        details = [status.sentence]
        if status is SolveStatus.UNVERIFIED:
            failed = [check for check in verification.checks if not check.passed]
            details += [f"{check.name} is {check.value}, the limit {check.limit}." for check in failed]
        if verification.note:
            details.append(verification.note)
        if status in (SolveStatus.EVALUATION_ERROR, SolveStatus.DIVERGED):
            error = find_evaluation_error(self.spec.problem, self.problem, trajectory)
            if error is not None:
                return SolveStatus.EVALUATION_ERROR, f"{SolveStatus.EVALUATION_ERROR.sentence} {error}"
        return status, " ".join(details)


def _meshes(spec: JobSpec) -> tuple[Mapping[str, Any], Sequence[Mesh]]:
    """What was done, as the ``method`` of the result, and the meshes from coarse to fine."""
    method = SplineWaveletMethod(name="swcm") if isinstance(spec.method, AutoMethod) else spec.method
    match method:
        case SplineWaveletMethod(L=length, J=finest):
            levels = sorted({finest, *range(finest - _LEVEL_STRIDE, _COARSEST_LEVEL - 1, -_LEVEL_STRIDE)})
            return {"name": "swcm", "L": length, "J": finest}, [
                lambda p, s, start, J=level: SplineWavelet(p, s, start, length, J) for level in levels
            ]
        case GaussPseudospectralMethod(nodes=nodes, segments=segments):
            breaks = np.linspace(0.0, 1.0, segments + 1)
            return {"name": "gpm", "nodes": nodes, "segments": segments}, [
                lambda p, s, start: GaussPseudospectral(p, s, start, breaks, nodes)
            ]
        case HermiteSimpsonMethod(intervals=intervals):
            knots = np.linspace(0.0, 1.0, intervals + 1)
            return {"name": "hermite_simpson", "intervals": intervals}, [
                lambda p, s, start: HermiteSimpson(p, s, start, knots)
            ]
    raise TypeError(f"no transcription for the method {method!r}")
