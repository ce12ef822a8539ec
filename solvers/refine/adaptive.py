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
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.problem import OptimalControlProblem
from solvers.refine.adaptive_optimality import suboptimality
from solvers.refine.jumps import Jump, jumps_of
from solvers.refine.residual import ArcErrors, arc_errors, flight_errors
from solvers.session import Solving
from solvers.solved import Ended, Solved, Stand
from solvers.start.guess import Start
from solvers.start.scaling import Scaling
from solvers.switching import is_switched
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription
from solvers.verification.violations import SMALLEST_SCALE, scale_of

Vector = NDArray[np.float64]

_ROUNDS = 30
# How much of what is left to do a mesh leaves to the next ones: only for the estimate of the fraction done.
_SHARE_OF_REST = 0.7
# The estimate may be off by this part: what is accepted is within the tolerance all the same.
_SAFETY = 0.8
# Where the flight over all arcs is off, each arc is asked for its part of what is allowed, and a little less.
_FLIGHT_SHARE = 0.9
# Of what controls may give away, the part for all that is no jump.
_REST_SHARE = 0.5
# Rounds in which the largest error must halve, or refinement does not help.
_PATIENCE = 6
# The program is solved at least this much more exactly than the mesh is asked to be.
_PROGRAM_SHARE = 1e-2
_MOST_EXACT_PROGRAM = 1e-12


class MeshLimit(Exception):
    """The mesh may not be refined where it would have to be; says which limit stands against it."""


class AdaptiveMesh(Protocol):
    """A mesh that knows how to become a better one."""

    def transcription(self, problem: OptimalControlProblem, scaling: Scaling, start: Start) -> Transcription:
        """The problem on this mesh."""
        ...

    def refined(
        self, trajectory: Trajectory, errors: Vector, target: float, jumps: Sequence[Jump] = ()
    ) -> AdaptiveMesh:
        """The next mesh, from the relative error (K,) between the breakpoints of the answer on this one.

        ``jumps``: those of controls from bound to bound, what they give away is no part of the errors. Raises
        :class:`MeshLimit`.
        """
        ...

    @property
    def summary(self) -> Mapping[str, Any]:
        """What the result says of the mesh."""
        ...

    @property
    def control_values(self) -> int:
        """How many values of each control are unknowns."""
        ...


@dataclass(frozen=True)
class Adapted(Generic[Ended]):
    """The answer on the last or the best meshes; ``reason``: why the tolerance was not reached, or None.

    ``error``: the largest estimated error of any kind, None where no mesh came to an answer.
    """

    solved: Ended
    meshes: Sequence[AdaptiveMesh]
    reason: str | None
    error: float | None


@dataclass(frozen=True)
class _Assessed:
    """Relative errors (K,) between breakpoints by part and what they must be, and the jumps by part.

    ``largest``: the largest error of any kind, which must be within ``limit``.
    """

    errors: Sequence[Vector]
    target: float
    jumps: Sequence[Sequence[Jump]]
    largest: float
    limit: float

    def better(self, meshes: Sequence[AdaptiveMesh], solved: Stand[Any, Any]) -> list[AdaptiveMesh]:
        """The next meshes; one that is good enough stays. Raises :class:`MeshLimit`."""
        return [
            mesh.refined(part.trajectory, own, self.target, jumps)
            if own.max() > self.target or any(jump.excess > 1.0 for jump in jumps)
            else mesh
            for mesh, part, own, jumps in zip(meshes, solved.parts, self.errors, self.jumps, strict=True)
        ]


def adapt(
    session: Solving[Ended],
    meshes: Sequence[AdaptiveMesh],
    tolerance: float,
    first: Ended,
    begun: float = 0.0,
    seconds: float = np.inf,
) -> Adapted[Ended]:
    """Refine until the relative error is within the tolerance, from the answer ``first`` on ``meshes``.

    ``begun``: the part of all work that is done; ``seconds``: what all meshes may take, where that is less
    than what the session leaves. Raises whatever the progress of the session raises.
    """
    asked, limits = session.tolerance, session.limits
    session.limits = replace(limits, deadline=min(limits.deadline, time.monotonic() + seconds))
    try:
        last, best, reason = _refined(session, meshes, tolerance, first, begun)
    finally:
        session.tolerance, session.limits = asked, limits
    if best is None:
        return Adapted(last, meshes, f"The adaptive mesh ended {last.outcome.status.value}.", None)
    if reason is None:
        return Adapted(best.solved, best.meshes, None, best.error)
    answer = best.solved
    if last.stopped:
        reason = f"{seconds:.0f} s were not enough" if session.stop is None else "it was stopped"
        if session.stop is not None:
            answer = replace(answer, outcome=replace(answer.outcome, status=last.outcome.status))
    elif not last.converged:
        reason = f"the program on a finer mesh ended {last.outcome.status.value}"
    detail = f"The adaptive mesh stopped at an estimated error of {best.error:.1e}: {reason}."
    return Adapted(answer, best.meshes, detail, best.error)


@dataclass(frozen=True)
class _Best(Generic[Ended]):
    """The converged answer of the smallest error."""

    error: float
    solved: Ended
    meshes: Sequence[AdaptiveMesh]


def _refined(
    session: Solving[Ended], meshes: Sequence[AdaptiveMesh], tolerance: float, solved: Ended, begun: float
) -> tuple[Ended, _Best[Ended] | None, str | None]:
    """The last answer, the best one; why that is not good enough, None if it is."""
    asked = session.tolerance
    best: _Best[Ended] | None = None
    history: list[float] = []
    for round_ in range(_ROUNDS):
        if not solved.converged:
            return solved, best, "it did not converge"
        started = time.perf_counter()
        assessed = _assess(session, solved, tolerance * _SAFETY)
        session.convergence[-1]["error_estimate"] = (
            assessed.largest if np.isfinite(assessed.largest) else None
        )
        if best is None or assessed.largest < best.error:
            best = _Best(assessed.largest, solved, meshes)
        if assessed.largest <= assessed.limit:
            return solved, best, None
        history.append(assessed.largest)
        if len(history) > _PATIENCE and min(history[-_PATIENCE:]) > 0.5 * min(history[:-_PATIENCE]):
            return solved, best, "refinement no longer helps"
        try:
            finer = assessed.better(meshes, solved)
        except MeshLimit as limit:
            return solved, best, str(limit)
        transcriptions = [
            mesh.transcription(part.problem, part.scaling, own.trajectory)
            for mesh, part, own in zip(finer, session.parts, solved.parts, strict=True)
        ]
        session.seconds["refine"] += time.perf_counter() - started
        left = (1.0 - begun) * _SHARE_OF_REST**round_
        share = 1.0 - left, 1.0 - left * _SHARE_OF_REST
        session.tolerance = min(asked, _program_tolerance(session, finer, tolerance))
        solved, meshes = session.solve_parts(transcriptions, f"mesh {round_ + 2}", share, warm=True), finer
    return solved, best, f"{_ROUNDS} meshes were not enough"


def _program_tolerance(session: Solving[Any], meshes: Sequence[AdaptiveMesh], tolerance: float) -> float:
    """How exactly programs are solved: each bound of each value of a control gives about that away."""
    bounds = sum(
        2 * sum(map(is_switched, part.problem.control_bounds)) * mesh.control_values
        for part, mesh in zip(session.parts, meshes, strict=True)
    )
    return max(tolerance * min(_PROGRAM_SHARE, 1.0 / max(bounds, 1)), _MOST_EXACT_PROGRAM)


def _assess(session: Solving[Ended], solved: Ended, limit: float) -> _Assessed:
    parts = solved.parts
    found = [arc_errors(item.transcription.problem, item.trajectory) for item in parts]
    errors = [np.nan_to_num(own.worst, nan=np.inf) for own in found]
    worst = max(float(own.max()) for own in errors)
    over_all = _flight_error(session, solved, found) or 0.0
    given_away = [_given_away(part) for part in parts]
    largest = max(worst, over_all, sum(float(own.sum()) for own in given_away))
    seen = [jumps_of(part.transcription.problem, part.trajectory) for part in parts]
    share = (1.0 - _REST_SHARE) * limit / max(sum(map(len, seen)), 1)
    split = [
        _at_jumps(own, part.trajectory.breakpoints, gap, share)
        for own, part, gap in zip(seen, parts, given_away, strict=True)
    ]
    jumps, rest = [own for own, _ in split], [gap for _, gap in split]
    target, total = limit, sum(float(own.sum()) for own in rest)
    if worst <= limit < over_all:
        # Every arc is good enough for itself, but their sum is not.
        target = _FLIGHT_SHARE * worst * limit / over_all
    elif worst <= limit and total > 0.0:
        # What counts is the sum: the arcs with the largest parts answer for all of it.
        weight = total / max(float(own.max()) for own in rest) / _REST_SHARE
        errors = [np.maximum(own, gap * weight) for own, gap in zip(errors, rest, strict=True)]
    return _Assessed(errors, target, jumps, largest, limit)


def _at_jumps(
    jumps: Sequence[Jump], breaks: Vector, given_away: Vector, share: float
) -> tuple[list[Jump], Vector]:
    """The jumps, each with how many times its ``share`` is given away there; and what is elsewhere, (K,)."""
    rest, found = given_away.copy(), []
    for jump in jumps:
        arcs = (breaks[1:] > jump.start) & (breaks[:-1] < jump.stop)
        found.append(replace(jump, excess=float(rest[arcs].sum()) / share))
        rest[arcs] = 0.0
    return found, rest


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
    gap = suboptimality(part.weighted_problem, part.trajectory, part.costates)
    return gap / max(abs(part.objective), SMALLEST_SCALE)
