"""The search for the true structure: multi-arc problems, changed until Pontryagin's conditions hold.

Arcs that shrink to nothing are dropped, arcs on which the switching function or the multiplier of a limit
has the wrong sign are cut, and where a free control comes to rest on a bound a new arc begins. Then nodes are
added until the dynamics hold between them. Each phase has arcs of its own, and all are solved together.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic

import numpy as np

from solvers.mesh_points import spline_mesh
from solvers.refine.arcs import TOLERANCE, Arcs, Refined, assessed, pattern_of
from solvers.refine.detection import find_structure
from solvers.refine.structure import Structure
from solvers.session import Solving
from solvers.solved import Ended, Solved, Stand
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.transcription.spline_wavelet import SplineWavelet

PROGRAM_TOLERANCE = 1e-12
"""How exactly multi-arc programs are solved: switching times enter the objective squared, a singular control
more weakly still, so that they are as good as the square root of this."""

ITERATIONS = 200
"""A program that starts from the one before and needs more iterations than these will not be right either."""

LOW_BARRIER = 1e-4
"""Where the barrier of multi-arc programs falls from: one that adapts loses arcs that are about to vanish."""

ACCEPTABLE = 1e-7
"""What the error of the states between nodes may be where more nodes do not help, relative to scales."""

WRONG_SIGN = 1e-3
"""The largest wrong value of a switching function that is accepted, relative to its largest value.

It is left where switches accumulate or structures would take turns.
"""

# Where IPOPT ends for its tolerance.
_NO_BARRIER = PROGRAM_TOLERANCE / 11.0
_ROUNDS = 16
# Where so many times the nodes have not brought the error down by the same factor, the structure is taken
# for a wrong one: it lacks arcs, and no number of nodes makes up for them.
_PATIENCE = 4.0
# Where the arcs that were found reach no target: splines on this mesh, next time one level finer. They let a
# control jump from knot to knot, where polynomials of higher degree chatter along limits.
LOOKS = 2
_LOOK_LENGTH, _LOOK_LEVEL = 8, 6


@dataclass
class Pace:
    """Whether more nodes help: with how many the last good step was done, and what was wanted there."""

    nodes: float = np.inf
    wants: float = np.inf

    def helps(self, nodes: int, wants: float, *, good: bool = False) -> bool:
        """Whether to go on after this many nodes, which leave this much to be wanted.

        From what is ``good`` enough, every single step has to help.
        """
        helped = wants <= self.wants / _PATIENCE
        if helped:
            self.nodes, self.wants = nodes, wants
        return helped if good else nodes <= _PATIENCE * self.nodes


@dataclass
class Search(Generic[Ended]):
    """Goes from structure to structure; keeps the patterns that it has tried and the best that it found.

    ``start``: a trajectory for each part; ``acceptable``: what the error between nodes may be at most.
    """

    session: Solving[Ended]
    start: Sequence[Trajectory]
    tried: set[Hashable] = field(default_factory=set)
    best: Refined[Ended] | None = None
    stopped: SolveStatus | None = None
    looks: int = 0
    acceptable: float = ACCEPTABLE

    def run(self, structures: Sequence[Structure]) -> str:
        """Search from ``structures``, one for each part; returns why it ended."""
        settled = False
        arcs = self._first(structures, self.start)
        pace = Pace()
        for round_ in range(_ROUNDS):
            solved = None if freedom(self.session, arcs) < 0 else self._solve(arcs, round_)
            if solved is None or not solved.converged:
                if solved is not None and solved.stopped:
                    self.stopped = solved.outcome.status
                    return "it was stopped"
                closer = self._look_closer(arcs, round_) if self.best is None else None
                if closer is None:
                    return (
                        "the arcs are too few"
                        if solved is None
                        else f"the program ended {solved.outcome.status}"
                    )
                arcs = closer
                continue
            if solved.collapsed:
                return "a phase shrinks to nothing"
            found, changes = assessed(solved, arcs)
            if found.wrong_sign <= WRONG_SIGN:
                self._keep(found)
            if changes is not None and not settled:
                pattern = pattern_of(
                    [new or part.structure for new, part in zip(changes, found.parts, strict=True)]
                )
                if pattern not in self.tried:
                    self.tried.add(pattern)
                    arcs = [part.changed(new) for part, new in zip(found.parts, changes, strict=True)]
                    pace = Pace()
                    continue
                # Structures take turns, or switches accumulate: the best so far, with nodes enough.
                if self.best is None:
                    return "the same structures come back"
                settled, found = True, self.best
            if found.wants <= TOLERANCE:
                return "done"
            good = self.best is not None and self.best.good_within(self.acceptable)
            if pace.helps(found.nodes, found.wants, good=good):
                arcs = [part.finer for part in found.parts]
                continue
            closer = None if good or found.error <= self.acceptable else self._look_closer(arcs, round_)
            if closer is None:
                return "more nodes do not help"
            arcs, settled, pace = closer, False, Pace()
        return f"no structure was settled on after {_ROUNDS} rounds"

    def _look_closer(self, arcs: Sequence[Arcs], round_: int) -> list[Arcs] | None:
        """The arcs of an answer on finer meshes; None after some attempts.

        A mesh does not see arcs shorter than its intervals, and bang arcs that are too few reach no target.
        """
        if self.looks == LOOKS:
            return None
        level = _LOOK_LEVEL + self.looks
        self.looks += 1
        self.session.barrier = LOW_BARRIER
        splines = []
        for part, own in zip(self.session.parts, arcs, strict=True):
            knots = spline_mesh(part.problem, _LOOK_LENGTH, level)
            adaptive = knots.finest > level
            splines.append(SplineWavelet(part.problem, part.scaling, own.start, knots, adaptive=adaptive))
        solved = self.session.solve_parts(splines, f"switching {round_ + 1}", _share(round_), warm=True)
        self.stopped = solved.outcome.status if solved.stopped else None
        if not solved.converged:
            return None
        return self._first(structures_of(solved), [part.trajectory for part in solved.parts])

    def _first(self, structures: Sequence[Structure], starts: Sequence[Trajectory]) -> list[Arcs]:
        self.tried.add(pattern_of(structures))
        triples = zip(self.session.parts, structures, starts, strict=True)
        return [Arcs.first(part, structure, start) for part, structure, start in triples]

    def _solve(self, arcs: Sequence[Arcs], round_: int) -> Ended:
        programs = [own.program(part) for part, own in zip(self.session.parts, arcs, strict=True)]
        # Without free controls, and with arcs that are there to stay, there is no bound to stay away from:
        # three steps of Newton's method, and where nothing is left to choose, on the equations alone.
        firm = all(own.firm for own in arcs)
        self.session.barrier = _NO_BARRIER if firm else LOW_BARRIER
        decided = firm and freedom(self.session, arcs) == 0
        stage = f"switching {round_ + 1}"
        return self.session.solve_parts(programs, stage, _share(round_), warm=True, decided=decided)

    def _keep(self, found: Refined[Ended]) -> None:
        """Keep the better one: of one pattern that of smaller error, else that of the smaller objective.

        What may become the answer is better than what may not.
        """
        best = self.best
        if best is None or best.pattern == found.pattern:
            better = best is None or found.wants < best.wants
        else:
            ranks = [(item.error > self.acceptable, item.solved.objective) for item in (found, best)]
            better = ranks[0] < ranks[1]
        if better:
            self.best = found


def structures_of(solved: Stand[Any, Any]) -> list[Structure]:
    """The structure of every part of a solved mesh."""
    return [_structure_of(part) for part in solved.parts]


def _structure_of(solved: Solved) -> Structure:
    return find_structure(
        solved.weighted_problem,
        solved.trajectory,
        lambda: solved.costates,
    )


def _share(round_: int) -> tuple[float, float]:
    """The part of all work that a round is: nobody knows how many will follow."""
    return 1.0 - 0.5 ** (round_ + 1), 1.0 - 0.5 ** (round_ + 2)


def freedom(session: Solving[Any], arcs: Sequence[Arcs]) -> float:
    """How many more unknown times than conditions on them there are; infinite where a control is free too."""
    if not all(own.structure.is_decided for own in arcs):
        return np.inf
    unknown, conditions = 0, session.joints
    for part, own in zip(session.parts, arcs, strict=True):
        problem = part.problem
        free = [bounds[0] < bounds[1] for bounds in (problem.initial_time, problem.final_time)]
        free += [bounds[0] < bounds[1] for bounds in problem.initial_state]
        free += [item.interval[0] < item.interval[1] for item in problem.design]
        held = [bounds[0] == bounds[1] for bounds in problem.final_state]
        held += [item.interval[0] == item.interval[1] for item in problem.boundary]
        held += [item.interval[0] == item.interval[1] for item in problem.integrals]
        unknown += own.structure.arcs - 1 + sum(free)
        conditions += sum(held) + own.structure.entry_conditions
    return unknown - conditions
