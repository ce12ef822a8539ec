"""Adaptive meshes: solve, estimate the error on every arc, refine where it is large, join where it is small.

Each mesh starts from the answer on the one before. The loop ends when no arc, nor the flight over all arcs,
nor the optimality of the bounded controls is off by more than the tolerance; or where the mesh may not be
refined any further, or refinement does not help: then the best answer comes back with the reason.

What a mesh is made of, and where it is refined, is each method's own: :mod:`solvers.refine.adaptive_splines`,
:mod:`solvers.refine.adaptive_gauss`, :mod:`solvers.refine.adaptive_intervals`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.guess import Start
from solvers.problem import OptimalControlProblem
from solvers.refine.adaptive_optimality import suboptimality
from solvers.refine.residual import arc_errors, flight_error
from solvers.scaling import Scaling
from solvers.session import Session, Solved
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription
from solvers.violations import SMALLEST_SCALE

Vector = NDArray[np.float64]

_ROUNDS = 30
# How much of what is left to do a mesh leaves to the next ones: only for the estimate of the fraction done.
_SHARE_OF_REST = 0.7
# The estimate may be off by this part: what is accepted is within the tolerance all the same.
_SAFETY = 0.8
# Where the flight over all arcs is off, each arc is asked for its part of what is allowed, and a little less.
_FLIGHT_SHARE = 0.9
# Rounds in which the largest error must halve, or refinement does not help.
_PATIENCE = 6
# The program is solved this much more exactly than the mesh is asked to be.
_PROGRAM_SHARE = 1e-2
_MOST_EXACT_PROGRAM = 1e-11


_ADVICE = (
    " Where a control jumps between its bounds or slides between them, no mesh does what method.refine:"
    " switching does."
)


class MeshLimit(Exception):
    """The mesh may not be refined where it would have to be; says which limit stands against it."""


class AdaptiveMesh(Protocol):
    """A mesh that knows how to become a better one."""

    def transcription(self, problem: OptimalControlProblem, scaling: Scaling, start: Start) -> Transcription:
        """The problem on this mesh."""
        ...

    def refined(self, trajectory: Trajectory, errors: Vector, target: float) -> AdaptiveMesh:
        """The next mesh, from the relative error (K,) between the breakpoints of the answer on this one.

        Raises :class:`MeshLimit`.
        """
        ...

    @property
    def summary(self) -> Mapping[str, Any]:
        """What the result says of the mesh."""
        ...


@dataclass(frozen=True)
class Adapted:
    """The answer on the last or the best mesh; ``reason``: why the tolerance was not reached, or None."""

    solved: Solved
    mesh: AdaptiveMesh
    reason: str | None


@dataclass(frozen=True)
class _Assessed:
    """Relative errors (K,) between breakpoints, what they must be, and the largest error of any kind."""

    errors: Vector
    target: float
    largest: float

    @property
    def excess(self) -> float:
        return float(self.errors.max()) / self.target


def adapt(
    session: Session, mesh: AdaptiveMesh, tolerance: float, first: Solved, begun: float = 0.0
) -> Adapted:
    """Refine until the relative error is within the tolerance, from the answer ``first`` on ``mesh``.

    ``begun``: the part of all work that is done. Raises whatever the progress of the session raises.
    """
    session.tolerance = min(session.tolerance, max(tolerance * _PROGRAM_SHARE, _MOST_EXACT_PROGRAM))
    solved = first
    best: tuple[float, Solved, AdaptiveMesh] | None = None
    history: list[float] = []
    reason = f"{_ROUNDS} meshes were not enough"
    for round_ in range(_ROUNDS):
        if not solved.converged:
            break
        started = time.perf_counter()
        assessed = _assess(session, solved, tolerance * _SAFETY)
        session.convergence[-1]["error_estimate"] = (
            assessed.largest if np.isfinite(assessed.largest) else None
        )
        if assessed.excess <= 1.0:
            return Adapted(solved, mesh, None)
        if best is None or assessed.largest < best[0]:
            best = (assessed.largest, solved, mesh)
        history.append(assessed.excess)
        if len(history) > _PATIENCE and min(history[-_PATIENCE:]) > 0.5 * min(history[:-_PATIENCE]):
            reason = "refinement no longer helps"
            break
        try:
            finer = mesh.refined(solved.trajectory, assessed.errors, assessed.target)
        except MeshLimit as limit:
            reason = str(limit)
            break
        transcription = finer.transcription(session.problem, session.scaling, solved.trajectory)
        session.seconds["refine"] += time.perf_counter() - started
        left = (1.0 - begun) * _SHARE_OF_REST**round_
        share = 1.0 - left, 1.0 - left * _SHARE_OF_REST
        solved, mesh = session.solve(transcription, f"mesh {round_ + 2}", share, warm=True), finer
    if best is None or solved.stopped:
        return Adapted(solved, mesh, f"The adaptive mesh ended {solved.outcome.status.value}.")
    if not solved.converged:
        reason = f"the program on a finer mesh ended {solved.outcome.status.value}"
    bounded = any(np.isfinite(bounds).all() for bounds in session.problem.control_bounds)
    advice = _ADVICE if bounded else ""
    detail = f"The adaptive mesh stopped at an estimated error of {best[0]:.1e}: {reason}.{advice}"
    return Adapted(best[1], best[2], detail)


def _assess(session: Session, solved: Solved, limit: float) -> _Assessed:
    problem, trajectory = session.problem, solved.trajectory
    found = arc_errors(problem, trajectory)
    errors = np.nan_to_num(found.worst, nan=np.inf)
    worst = float(errors.max())
    if worst > limit:
        return _Assessed(errors, limit, worst)
    # Every arc is good enough for itself: is their sum, and does the control use what it may?
    over_all = flight_error(problem, trajectory, found)
    if over_all is not None and over_all > limit:
        return _Assessed(errors, _FLIGHT_SHARE * worst * limit / over_all, over_all)
    costates = solved.transcription.costates(trajectory, solved.outcome.row_multipliers)
    given_away = suboptimality(solved.weighted_problem, trajectory, costates) / max(
        abs(solved.objective), SMALLEST_SCALE
    )
    total = float(given_away.sum())
    if total > 0.0:
        # What counts is the sum: the arcs with the largest parts answer for all of it.
        errors = np.maximum(errors, given_away * (total / given_away.max()))
    return _Assessed(errors, limit, float(errors.max()))
