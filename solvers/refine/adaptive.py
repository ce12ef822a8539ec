"""Adaptive meshes: solve, estimate the error on every arc, refine where it is large, join where it is small.

Each mesh starts from the answer on the one before. The loop ends when no arc, nor the flight over all arcs,
nor the optimality of the bounded controls is off by more than the tolerance; or where the mesh may not be
refined any further, or refinement does not help: then the best answer comes back with the reason.

What a mesh is made of, and where it is refined, is each method's own: :mod:`solvers.refine.adaptive_splines`,
:mod:`solvers.refine.adaptive_gauss`, :mod:`solvers.refine.adaptive_intervals`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.guess import Start
from solvers.problem import OptimalControlProblem
from solvers.refine.adaptive_optimality import suboptimality
from solvers.refine.residual import ArcErrors, arc_errors, flight_errors
from solvers.scaling import Scaling
from solvers.session import Ended, Solved, Solving, Stand
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription
from solvers.violations import SMALLEST_SCALE, scale_of

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
class Adapted(Generic[Ended]):
    """The answer on the last or the best meshes; ``reason``: why the tolerance was not reached, or None."""

    solved: Ended
    meshes: Sequence[AdaptiveMesh]
    reason: str | None


@dataclass(frozen=True)
class _Assessed:
    """Relative errors (K,) between breakpoints by part, what they must be, and the largest of any kind."""

    errors: Sequence[Vector]
    target: float
    largest: float

    @property
    def excess(self) -> float:
        return max(float(own.max()) for own in self.errors) / self.target

    def better(self, meshes: Sequence[AdaptiveMesh], solved: Stand[Any, Any]) -> list[AdaptiveMesh]:
        """The next meshes; one that is good enough stays. Raises :class:`MeshLimit`."""
        return [
            mesh.refined(part.trajectory, own, self.target) if own.max() > self.target else mesh
            for mesh, part, own in zip(meshes, solved.parts, self.errors, strict=True)
        ]


def adapt(
    session: Solving[Ended],
    meshes: Sequence[AdaptiveMesh],
    tolerance: float,
    first: Ended,
    begun: float = 0.0,
) -> Adapted[Ended]:
    """Refine until the relative error is within the tolerance, from the answer ``first`` on ``meshes``.

    ``begun``: the part of all work that is done. Raises whatever the progress of the session raises.
    """
    session.tolerance = min(session.tolerance, max(tolerance * _PROGRAM_SHARE, _MOST_EXACT_PROGRAM))
    solved = first
    best: tuple[float, Ended, Sequence[AdaptiveMesh]] | None = None
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
            return Adapted(solved, meshes, None)
        if best is None or assessed.largest < best[0]:
            best = (assessed.largest, solved, meshes)
        history.append(assessed.excess)
        if len(history) > _PATIENCE and min(history[-_PATIENCE:]) > 0.5 * min(history[:-_PATIENCE]):
            reason = "refinement no longer helps"
            break
        try:
            finer = assessed.better(meshes, solved)
        except MeshLimit as limit:
            reason = str(limit)
            break
        transcriptions = [
            mesh.transcription(part.problem, part.scaling, own.trajectory)
            for mesh, part, own in zip(finer, session.parts, solved.parts, strict=True)
        ]
        session.seconds["refine"] += time.perf_counter() - started
        left = (1.0 - begun) * _SHARE_OF_REST**round_
        share = 1.0 - left, 1.0 - left * _SHARE_OF_REST
        solved, meshes = session.solve_parts(transcriptions, f"mesh {round_ + 2}", share, warm=True), finer
    if best is None or solved.stopped:
        return Adapted(solved, meshes, f"The adaptive mesh ended {solved.outcome.status.value}.")
    if not solved.converged:
        reason = f"the program on a finer mesh ended {solved.outcome.status.value}"
    bounded = any(np.isfinite(own).all() for part in session.parts for own in part.problem.control_bounds)
    advice = _ADVICE if bounded else ""
    detail = f"The adaptive mesh stopped at an estimated error of {best[0]:.1e}: {reason}.{advice}"
    return Adapted(best[1], best[2], detail)


def _assess(session: Solving[Ended], solved: Ended, limit: float) -> _Assessed:
    parts = solved.parts
    found = [arc_errors(item.transcription.problem, item.trajectory) for item in parts]
    errors = [np.nan_to_num(own.worst, nan=np.inf) for own in found]
    worst = max(float(own.max()) for own in errors)
    if worst > limit:
        return _Assessed(errors, limit, worst)
    # Every arc is good enough for itself: is their sum, and do the controls use what they may?
    over_all = _flight_error(session, solved, found)
    if over_all is not None and over_all > limit:
        return _Assessed(errors, _FLIGHT_SHARE * worst * limit / over_all, over_all)
    given_away = [_given_away(part) for part in parts]
    total = sum(float(own.sum()) for own in given_away)
    if total > 0.0:
        # What counts is the sum: the arcs with the largest parts answer for all of it.
        share = total / max(float(own.max()) for own in given_away)
        errors = [np.maximum(own, gap * share) for own, gap in zip(errors, given_away, strict=True)]
    return _Assessed(errors, limit, max(float(own.max()) for own in errors))


def _flight_error(session: Solving[Ended], solved: Ended, found: Sequence[ArcErrors]) -> float | None:
    """The largest relative error at the end of any part, after those of parts before; None if meaningless."""
    largest, end = 0.0, None
    for index, (part, own) in enumerate(zip(solved.parts, found, strict=True)):
        scale = scale_of(part.trajectory.states_at(part.trajectory.breakpoints))
        begin = None if end is None else session.carried(solved, index, end) / scale
        errors = flight_errors(part.transcription.problem, part.trajectory, own, begin)
        if errors is None:
            return None
        largest, end = max(largest, float(np.max(np.abs(errors)))), errors * scale
    return largest


def _given_away(part: Solved) -> Vector:
    """What the controls of a part give away between breakpoints, relative to the objective, (K,)."""
    costates = part.transcription.costates(part.trajectory, part.outcome.row_multipliers)
    gap = suboptimality(part.weighted_problem, part.trajectory, costates)
    return gap / max(abs(part.objective), SMALLEST_SCALE)
