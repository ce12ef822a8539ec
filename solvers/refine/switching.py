"""Switching refinement: from an answer on a mesh to its true structure, with the switching times as unknowns.

Arcs are read off the answer (:mod:`solvers.refine.detection`) and solved as a multi-arc problem, whose
structure and mesh are changed until Pontryagin's conditions and the dynamics hold
(:mod:`solvers.refine.search`). The refined answer replaces the first one if its bounds, signs and objective
allow it; otherwise the first one stays, with the reason.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic

import numpy as np

from solvers.formulation.lifting import is_slack
from solvers.formulation.quantities import WHOLE_SPAN
from solvers.limits import limits_of
from solvers.part import Part
from solvers.problem import OptimalControlProblem
from solvers.refine.arcs import DRIFT, Refined
from solvers.refine.detection import find_structure
from solvers.refine.residual import arc_errors
from solvers.refine.search import (
    ACCEPTABLE,
    ITERATIONS,
    LOOKS,
    PROGRAM_TOLERANCE,
    WRONG_SIGN,
    Search,
    structures_of,
)
from solvers.refine.structure import Structure
from solvers.session import Solving
from solvers.solved import Ended, Stand
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Check, Verification
from solvers.verification.violations import dense

# The objective may not get worse by more than the first part of itself, if the states of the first answer are
# right to the second part of their scales.
_WORSE = 1e-3
_BELIEVED = 1e-2


@dataclass(frozen=True)
class Refinement(Generic[Ended]):
    """The refined answer, or the first one and why it stays."""

    solved: Ended
    refined: Refined[Ended] | None
    reason: str

    @property
    def summary(self) -> dict[str, Any]:
        """What was done, for the ``method`` of the result; ``refine`` is None if the first answer stays."""
        if self.refined is None:
            return {"refine": None}
        counts = [list(counts) for part in self.refined.parts for counts in part.mesh.counts]
        return {"refine": "switching", "arcs": len(counts), "arc_nodes": counts}

    @property
    def warnings(self) -> list[dict[str, str]]:
        """Why the first answer stays, if it does."""
        if self.refined is not None:
            return []
        return [{"code": "refinement_failed", "pointer": "/method/refine", "detail": self.reason}]

    def certified(self, verification: Verification) -> Verification:
        """The verification with what else a refined answer must show: its signs, its Hamiltonian."""
        if self.refined is None:
            return verification
        checks = [Check("switching_sign", self.refined.wrong_sign, WRONG_SIGN)]
        if verification.hamiltonian_drift is not None:
            checks.append(Check("hamiltonian_drift", verification.hamiltonian_drift, DRIFT))
        return replace(verification, checks=(*verification.checks, *checks))


def is_refinable(parts: Sequence[Part]) -> bool:
    """Whether arcs can be looked for: not with windows of constraints, nor with controls bound at the ends.

    Windows would have to begin inside of arcs; a control that rests on a bound does not jump to its end.
    """
    return all(_has_arcs(part.problem) for part in parts)


def _has_arcs(problem: OptimalControlProblem) -> bool:
    ends = [*problem.initial_control, *problem.final_control]
    if any(map(is_slack, problem.controls)):
        return False  # slacks are no controls that switch
    return not np.isfinite(ends).any() and all(item.during == WHOLE_SPAN for item in problem.path)


def refine_switching(
    session: Solving[Ended], first: Ended, acceptable: float = ACCEPTABLE, seconds: float = np.inf
) -> Refinement[Ended]:
    """Find the structure of a converged answer and solve for its switching times.

    ``acceptable``: what the error of the states between nodes may be at most, relative to scales;
    ``seconds``: what the search may take, where that is less than what the session leaves. Raises whatever
    the progress of the session raises.
    """
    if not is_refinable(session.parts):
        return Refinement(first, None, "slacks that stand for corners are no controls that rest on bounds")
    start = [part.trajectory for part in first.parts]
    search, reason = _searched(
        session, start, lambda: structures_of(first), acceptable=acceptable, seconds=seconds
    )
    return _judged(first, search, reason)


def resume_switching(session: Solving[Ended], earlier: Sequence[Trajectory]) -> Refinement[Ended] | None:
    """The refined answer to which the structures of earlier parts lead; None where they lead to none.

    Signs, bounds and errors are judged as ever, so that a structure that has changed is seen. Raises whatever
    the progress of the session raises.
    """
    problems = [part.problem for part in session.parts]
    names = [(tuple(part.states), tuple(part.controls)) for part in earlier]
    if not is_refinable(session.parts) or names != [(own.states, own.controls) for own in problems]:
        return None
    search, reason = _searched(
        session, earlier, lambda: list(map(find_structure, problems, earlier)), looks=LOOKS
    )
    best = search.best
    if best is None or best.error > ACCEPTABLE or search.stopped is not None:
        return None
    # A limit that was not met before is not among the arcs: it is seen by who solves a mesh.
    if any(_leaves_limits(part.problem, part.solved.trajectory) for part in best.parts):
        return None
    return Refinement(best.solved, best, reason)


def _leaves_limits(problem: OptimalControlProblem, trajectory: Trajectory) -> bool:
    tau = dense(trajectory.breakpoints)
    rooms = [limit.room(problem, trajectory, tau) for limit in limits_of(problem)]
    return any(room.min() < -ACCEPTABLE * max(float(np.ptp(room)), 1e-6) for room in rooms)


def _searched(
    session: Solving[Ended],
    start: Sequence[Trajectory],
    structures: Callable[[], Sequence[Structure]],
    looks: int = 0,
    acceptable: float = ACCEPTABLE,
    seconds: float = np.inf,
) -> tuple[Search[Ended], str]:
    """A search that has come to its end, and why it did; ``looks``: how many of its closer looks are gone."""
    started = time.perf_counter()
    inner = replace(
        session,
        tolerance=min(session.tolerance, PROGRAM_TOLERANCE),
        max_iterations=min(session.max_iterations, ITERATIONS),
        seconds={"build": 0.0, "solve": 0.0},
        limits=replace(session.limits, deadline=min(session.limits.deadline, time.monotonic() + seconds)),
    )
    search = Search(inner, start, looks=looks, acceptable=acceptable)
    reason = search.run(structures())
    if search.stopped is not None and session.stop is None:
        search.stopped, reason = None, f"{seconds:.0f} s were not enough"
    session.iterations = inner.iterations
    session.seconds["refine"] += time.perf_counter() - started
    return search, reason


def _judged(first: Ended, search: Search[Ended], reason: str) -> Refinement[Ended]:
    """The best that was found, if it may replace the first answer."""
    best = search.best
    if best is not None and search.stopped is None:
        if best.error > search.acceptable:
            reason = f"the states or the Hamiltonian are wrong by {best.error:.1e} between nodes; {reason}"
        elif _is_worse(first, best.solved):
            reason = f"the objective would get worse by {best.solved.objective - first.objective:.1e}"
        else:
            return Refinement(best.solved, best, reason)
    # The first answer stays; it counts as stopped where somebody or the clock asked to stop.
    status = search.stopped or first.outcome.status
    return Refinement(replace(first, outcome=replace(first.outcome, status=status)), None, reason)


def _is_worse(first: Stand[Any, Any], refined: Stand[Any, Any]) -> bool:
    """Whether the objective is worse than that of a first answer whose states can be believed."""
    worse = refined.objective - first.objective
    if worse <= _WORSE * max(abs(first.objective), abs(refined.objective), 1e-6):
        return False
    errors = [arc_errors(part.transcription.problem, part.trajectory).states.max() for part in first.parts]
    return float(max(errors)) <= _BELIEVED
