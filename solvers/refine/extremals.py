"""Other switching structures that reach the target: bang-bang controls, stationary in their switching times.

Where a refined answer rests on bounds from end to end, controls with as many switches at other instants may
reach the same ends. They are no local optima of the problem on a mesh: most of them have a switching function
of the wrong sign somewhere, so that a mesh, whose controls are free at every node, slides off them. Here the
pattern is held, only the instants move: drawn at random, flown, and moved until the flight reaches the ends.

The numbers come from a Halton sequence (Halton 1960), the same every time. Multi-arc problems with fixed
patterns: Kaya, Noakes, "Computational method for time-optimal switching control", J. Optim. Theory Appl.
117, 2003.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from solvers.problem import OptimalControlProblem
from solvers.refine.arcs import Arcs, RefinedPart
from solvers.refine.bang_bang import BangBangFlights
from solvers.refine.search import LOW_BARRIER, PROGRAM_TOLERANCE, WRONG_SIGN, freedom
from solvers.refine.signs import next_structure
from solvers.refine.structure import SHORTEST_ARC, Structure
from solvers.session import Session
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

# Flights that are drawn, and more for each start that is asked for: one in ten comes near the target, at
# little cost. Their durations are between these multiples of that of the answer.
_DRAWS, _DRAWS_PER_START = 100, 4
_DURATIONS = 0.8, 1.6
# Rough flights are one if their arcs agree to the first part of the duration.
_ALIKE = 1e-2
# Two structures are one if their objectives and instants agree to this part.
_SAME = 1e-6
# What is not found soon from random instants is not worth its time.
_ITERATIONS = 60
# How wrong the states between nodes may be, relative: more, and it reaches no target.
_BELIEVED = 1e-6


@dataclass(frozen=True)
class Extremal:
    """A control of the answer's pattern, or of the opposite one, that reaches the ends."""

    found: RefinedPart

    @property
    def objective(self) -> float:
        """The objective of the document."""
        return self.found.solved.objective

    @property
    def obeys_signs(self) -> bool:
        """Whether its switching functions have the signs that Pontryagin's principle asks for."""
        return self.found.wrong_sign <= WRONG_SIGN

    def report(self, problem: OptimalControlProblem) -> dict[str, Any]:
        """The entry of ``starts`` of a result."""
        trajectory = self.found.solved.trajectory
        switching = self.found.structure.switching(problem, trajectory)
        return {
            "objective": self.objective,
            "final_time": trajectory.tf,
            "status": SolveStatus.CONVERGED.value,
            "kept": False,
            "switching": {name: item["times"] for name, item in switching.items()},
            "wrong_sign": self.found.wrong_sign,
        }


def other_extremals(session: Session, answer: RefinedPart, count: int) -> list[Extremal]:
    """What ``count`` draws of switching instants lead to, each once, without ``answer``, best first.

    Nothing where the answer has a free control or follows a limit. Raises whatever the progress of the
    session raises.
    """
    structure = answer.structure
    if structure.is_free or structure.followed or structure.touched:
        return []
    inner = replace(
        session,
        tolerance=PROGRAM_TOLERANCE,
        max_iterations=min(_ITERATIONS, session.max_iterations),
        barrier=LOW_BARRIER,
        convergence=[],
        iterations=0,
        seconds={"build": 0.0, "solve": 0.0, "refine": 0.0},
    )
    known = [answer]
    for start in _starts(session, answer, count):
        if session.stop is not None:
            break
        found = _solved(inner, start)
        if found is not None and not any(_same(found, other) for other in known):
            known.append(found)
    session.iterations += inner.iterations
    session.seconds["refine"] += sum(inner.seconds.values())
    return sorted((Extremal(found) for found in known[1:]), key=lambda item: item.objective)


_Start = tuple[Structure, Trajectory]


def _starts(session: Session, answer: RefinedPart, count: int) -> Iterator[_Start]:
    """At most ``count`` patterns and flights that nearly reach the ends, from drawn ones."""
    problem = session.problem
    levels, durations = _drawn(problem, answer, _DRAWS + _DRAWS_PER_START * count)
    near = answer.solved.trajectory
    flights = BangBangFlights(problem, near, levels)
    found = flights.to_target(durations, lambda: session.stop is not None)
    lasting = np.flatnonzero(found.min(axis=1) > SHORTEST_ARC * found.sum(axis=1))  # NaN is not
    for index in _distinct(found, lasting)[:count]:
        lengths = found[index]
        edges = np.append(0.0, np.cumsum(lengths)) / lengths.sum()
        pinned = dict(zip(problem.controls, levels[index], strict=True))
        yield replace(answer.structure, edges=edges, pinned=pinned), flights.trajectory(index, lengths)


def _distinct(lengths: Vector, chosen: NDArray[np.intp]) -> list[int]:
    """Of the chosen rows those that are not near an earlier one, the shortest flights first."""
    kept: list[int] = []
    for index in chosen[np.argsort(lengths[chosen].sum(axis=1))]:
        near = _ALIKE * lengths[index].sum()
        if all(np.abs(lengths[index] - lengths[other]).max() > near for other in kept):
            kept.append(int(index))
    return kept


def _drawn(problem: OptimalControlProblem, answer: RefinedPart, count: int) -> tuple[Vector, Vector]:
    """Levels (count, m, S) and lengths (count, S) of arcs drawn at random.

    Each control has as many switches as in the answer, and begins as there or, every other time, opposite.
    """
    structure, duration = answer.structure, answer.solved.trajectory.duration
    switches = [int(np.count_nonzero(np.diff(levels))) for levels in structure.pinned.values()]
    # A Halton sequence without scrambling begins at a corner of the cube: leave that point out.
    points = qmc.Halton(1 + sum(switches), scramble=False).random(count + 1)[1:]
    shortest, longest = _DURATIONS
    durations = duration * shortest * (longest / shortest) ** points[:, :1]
    edges = np.sort(np.pad(points[:, 1:], ((0, 0), (1, 1)), constant_values=(0.0, 1.0)), axis=1)
    edges[:, 0], edges[:, -1] = 0.0, 1.0
    middles = (edges[:, 1:] + edges[:, :-1]) / 2.0
    opposite = np.arange(count)[:, None] % 2
    owned = np.split(points[:, 1:], np.cumsum(switches)[:-1], axis=1)
    levels = []
    for own, bounds, first in zip(owned, problem.control_bounds, structure.pinned.values(), strict=True):
        changes = (own[:, :, None] < middles[:, None, :]).sum(axis=1) + opposite
        levels.append(np.where(changes % 2, bounds[0] + bounds[1] - first[0], first[0]))
    return np.stack(levels, axis=1), durations * np.diff(edges, axis=1)


def _solved(session: Session, start: _Start) -> RefinedPart | None:
    """Where a structure leads with its pattern held; None if it reaches no target, or loses an arc."""
    problem = session.problem
    (part,) = session.parts
    arcs = Arcs.first(part, *start)
    decided = freedom(session, [arcs]) == 0
    solved = session.solve_parts([arcs.program(part)], "other structures", warm=True, decided=decided)
    if not solved.converged:
        return None
    found = RefinedPart.read(solved, arcs)
    wrong_sign, _ = next_structure(problem, solved, found.structure, found.error)
    if found.error > _BELIEVED or not np.isfinite(wrong_sign):
        return None
    return replace(found, wrong_sign=wrong_sign)


def _same(one: RefinedPart, other: RefinedPart) -> bool:
    scale = max(abs(one.solved.objective), abs(other.solved.objective), 1e-6)
    return (
        one.structure.pattern == other.structure.pattern
        and abs(one.solved.objective - other.solved.objective) <= _SAME * scale
        and bool(np.all(np.abs(one.structure.edges - other.structure.edges) <= _SAME))
    )
