"""The search for the true structure: multi-arc problems, changed until Pontryagin's conditions hold.

Arcs that shrink to nothing are dropped, arcs on which the switching function or the multiplier of a limit
has the wrong sign are cut, and where a free control comes to rest on a bound a new arc begins. Then nodes are
added until the dynamics hold between them. Each phase has arcs of its own, and all are solved together.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from solvers.mesh_points import spline_mesh
from solvers.problem import OptimalControlProblem
from solvers.refine.detection import find_structure
from solvers.refine.mesh import ArcMesh, first_mesh
from solvers.refine.residual import arc_errors
from solvers.refine.signs import next_structure
from solvers.refine.structure import Structure
from solvers.session import Ended, Part, Solved, Solving, Stand
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.transcription.multi_arc import MultiArc
from solvers.transcription.spline_wavelet import SplineWavelet

Vector = NDArray[np.float64]

PROGRAM_TOLERANCE = 1e-12
"""How exactly multi-arc programs are solved: switching times enter the objective squared, a singular control
more weakly still, so that they are as good as the square root of this."""

ITERATIONS = 200
"""A program that starts from the one before and needs more iterations than these will not be right either."""

LOW_BARRIER = 1e-4
"""Where the barrier of multi-arc programs falls from: one that adapts loses arcs that are about to vanish."""

TOLERANCE = 5e-9
"""What the error of the states between nodes should be, relative to each state's scale."""

DRIFT = 1e-6
"""How far the Hamiltonian may wander, relative to the magnitude of its terms."""

ACCEPTABLE = 1e-7
"""What the error of the states between nodes may be where more nodes do not help, relative to scales."""

WRONG_SIGN = 1e-3
"""The largest wrong value of a switching function that is accepted, relative to its largest value.

It is left where switches accumulate or structures would take turns.
"""

# Where IPOPT ends for its tolerance.
_NO_BARRIER = PROGRAM_TOLERANCE / 11.0
# An arc of this part of the horizon does not vanish.
_FIRM = 0.02
_ROUNDS = 16
# Where so many times the nodes have not brought the error down by the same factor, the structure is taken
# for a wrong one: it lacks arcs, and no number of nodes makes up for them.
_PATIENCE = 4.0
# Where the arcs that were found reach no target: splines on this mesh, next time one level finer. They let a
# control jump from knot to knot, where polynomials of higher degree chatter along limits.
LOOKS = 2
_LOOK_LENGTH, _LOOK_LEVEL = 8, 6
# The part of what the Hamiltonian may wander that more nodes aim at.
_DRIFT_AIM = 0.1
# By how much bounds and path constraints may be left between nodes, relative to scales: more nodes aim at it.
_OUTSIDE_AIM = 1e-7
# An arc is cut where the sign is wrong by more than this, and by more than the error of the states.
_CUT = 1e-6


@dataclass(frozen=True)
class Arcs:
    """The arcs of a part and their mesh, to be solved from ``start``."""

    structure: Structure
    mesh: ArcMesh
    start: Trajectory

    @classmethod
    def first(cls, part: Part, structure: Structure, start: Trajectory) -> Arcs:
        """Arcs on the mesh that the model asks for."""
        return cls(structure, first_mesh(part.problem, start, structure), start)

    @property
    def firm(self) -> bool:
        """Whether no control is free, and no arc so short that it may vanish."""
        return not self.structure.is_free and bool(np.diff(self.structure.edges).min() >= _FIRM)

    def program(self, part: Part) -> MultiArc:
        """The multi-arc problem."""
        return MultiArc(
            part.problem,
            part.scaling,
            self.start,
            self.mesh.breaks(self.structure.edges),
            self.mesh.flat_counts,
            self.mesh.parts,
            self.structure.pinned,
            self.structure.follows(part.problem, self.start),
        )


@dataclass(frozen=True)
class RefinedPart:
    """A solved part with its structure and mesh.

    ``errors``: of the states, segment by segment; ``outside``: how far bounds and path constraints are left
    there; ``wrong_sign``: the largest wrong value of a switching function; all relative.
    """

    solved: Solved
    structure: Structure
    mesh: ArcMesh
    errors: Vector
    outside: Vector
    wrong_sign: float = np.inf

    @classmethod
    def read(cls, solved: Solved, arcs: Arcs) -> RefinedPart:
        """What came of arcs; nothing is said of signs yet."""
        program = solved.transcription
        assert isinstance(program, MultiArc)
        structure = replace(arcs.structure, edges=program.edges_of(solved.trajectory))
        errors = arc_errors(program.problem, solved.trajectory)
        states, outside = errors.states.max(axis=0), np.maximum(errors.bounds, errors.path)
        return cls(solved, structure, arcs.mesh, program.by_segment(states), program.by_segment(outside))

    @property
    def problem(self) -> OptimalControlProblem:
        """The problem of the part."""
        return self.solved.transcription.problem

    @property
    def error(self) -> float:
        """The largest of the errors."""
        return float(self.errors.max())

    @property
    def wants(self) -> Vector:
        """What more nodes are for, segment by segment: errors, and what is left as if it were an error."""
        return np.maximum(self.errors, TOLERANCE * self.outside / _OUTSIDE_AIM)

    @property
    def finer(self) -> Arcs:
        """The same arcs, with more nodes where these are wanted."""
        start = self.solved.trajectory
        return Arcs(self.structure, self.mesh.refined(start, self.wants, TOLERANCE), start)

    def changed(self, structure: Structure | None) -> Arcs:
        """Other arcs; these, where there is no change."""
        start = self.solved.trajectory
        mesh = self.mesh if structure is None else first_mesh(self.problem, start, structure)
        return Arcs(structure or self.structure, mesh, start)


@dataclass(frozen=True)
class Refined(Generic[Ended]):
    """A solved multi-arc problem, part by part."""

    solved: Ended
    parts: tuple[RefinedPart, ...]

    @property
    def error(self) -> float:
        """The largest of the errors."""
        return max(part.error for part in self.parts)

    @property
    def nodes(self) -> int:
        """The number of nodes."""
        return sum(sum(part.mesh.flat_counts) for part in self.parts)

    @property
    def outside(self) -> float:
        """The farthest that a bound or a path constraint is left by between nodes."""
        return max(float(part.outside.max()) for part in self.parts)

    @property
    def wants(self) -> float:
        """The largest of what more nodes are for."""
        return max(float(part.wants.max()) for part in self.parts)

    @property
    def wrong_sign(self) -> float:
        """The largest wrong value of a switching function."""
        return max(part.wrong_sign for part in self.parts)

    @property
    def pattern(self) -> Hashable:
        """What is the same for structures that differ in instants only."""
        return _pattern([part.structure for part in self.parts])


@dataclass
class Pace:
    """Whether more nodes help: with how many the last good step was done, and what was wanted there."""

    nodes: float = np.inf
    wants: float = np.inf

    def helps(self, nodes: int, wants: float) -> bool:
        """Whether to go on after this many nodes, which leave this much to be wanted."""
        if wants <= self.wants / _PATIENCE:
            self.nodes, self.wants = nodes, wants
        return nodes <= _PATIENCE * self.nodes


@dataclass
class Search(Generic[Ended]):
    """Goes from structure to structure; keeps the patterns that it has tried and the best that it found.

    ``start``: a trajectory for each part.
    """

    session: Solving[Ended]
    start: Sequence[Trajectory]
    tried: set[Hashable] = field(default_factory=set)
    best: Refined[Ended] | None = None
    stopped: SolveStatus | None = None
    looks: int = 0

    def run(self, structures: Sequence[Structure]) -> str:
        """Search from ``structures``, one for each part; returns why it ended."""
        settled = False
        arcs = self._first(structures, self.start)
        pace = Pace()
        for round_ in range(_ROUNDS):
            solved = None if _too_few_arcs(self.session, arcs) else self._solve(arcs, round_)
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
            found, changes = _assessed(solved, arcs)
            if found.wrong_sign <= WRONG_SIGN:
                self._keep(found)
            if changes is not None and not settled:
                pattern = _pattern(
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
            if pace.helps(found.nodes, found.wants):
                arcs = [part.finer for part in found.parts]
                continue
            closer = self._look_closer(arcs, round_) if found.error > ACCEPTABLE else None
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
        self.tried.add(_pattern(structures))
        triples = zip(self.session.parts, structures, starts, strict=True)
        return [Arcs.first(part, structure, start) for part, structure, start in triples]

    def _solve(self, arcs: Sequence[Arcs], round_: int) -> Ended:
        programs = [own.program(part) for part, own in zip(self.session.parts, arcs, strict=True)]
        # Without free controls, and with arcs that are there to stay, there is no bound to stay away from:
        # three steps of Newton's method.
        self.session.barrier = _NO_BARRIER if all(own.firm for own in arcs) else LOW_BARRIER
        return self.session.solve_parts(programs, f"switching {round_ + 1}", _share(round_), warm=True)

    def _keep(self, found: Refined[Ended]) -> None:
        """Keep the better one: of one pattern that of smaller error, else that of the smaller objective.

        What may become the answer is better than what may not.
        """
        best = self.best
        if best is None or best.pattern == found.pattern:
            better = best is None or found.wants < best.wants
        else:
            ranks = [(item.error > ACCEPTABLE, item.solved.objective) for item in (found, best)]
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


def _pattern(structures: Sequence[Structure]) -> Hashable:
    return tuple(structure.pattern for structure in structures)


def _assessed(
    solved: Ended, arcs: Sequence[Arcs]
) -> tuple[Refined[Ended], Sequence[Structure | None] | None]:
    """What came of arcs, and what becomes of the structure of each part; None where all may stay."""
    parts = [RefinedPart.read(part, own) for part, own in zip(solved.parts, arcs, strict=True)]
    error = max(part.error for part in parts)
    signs = [next_structure(part.problem, part.solved, part.structure, max(_CUT, error)) for part in parts]
    worst = max(wrong for wrong, _ in signs)
    # While arcs vanish in one part, signs say nothing in the others either.
    changes = [new if wrong == worst or np.isfinite(worst) else None for wrong, new in signs]
    if error <= TOLERANCE:
        parts = [replace(part, errors=np.maximum(part.errors, _wander(part.solved))) for part in parts]
    parts = [replace(part, wrong_sign=wrong) for part, (wrong, _) in zip(parts, signs, strict=True)]
    return Refined(solved, tuple(parts)), changes if any(changes) else None


def _wander(solved: Solved) -> float:
    """What the Hamiltonian says of all segments: 0 where it is constant enough, else as an error of states.

    States may be right between the nodes for whatever control is flown: x' = u is. The control is the best
    one only where the Hamiltonian is constant.
    """
    drift = solved.hamiltonian_drift
    return 0.0 if drift is None or drift <= DRIFT else TOLERANCE * drift / (_DRIFT_AIM * DRIFT)


def _share(round_: int) -> tuple[float, float]:
    """The part of all work that a round is: nobody knows how many will follow."""
    return 1.0 - 0.5 ** (round_ + 1), 1.0 - 0.5 ** (round_ + 2)


def _too_few_arcs(session: Solving[Any], arcs: Sequence[Arcs]) -> bool:
    """Whether arcs that leave nothing free have fewer unknown times than there are conditions on them."""
    if not all(own.structure.is_decided for own in arcs):
        return False
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
    return unknown < conditions
