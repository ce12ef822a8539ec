"""Arcs of every part of a problem, and what came of them when they were solved."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from solvers.part import Part
from solvers.problem import OptimalControlProblem
from solvers.refine.mesh import ArcMesh, first_mesh
from solvers.refine.residual import arc_errors
from solvers.refine.signs import next_structure
from solvers.refine.structure import Structure
from solvers.solved import Ended, Solved
from solvers.trajectory import Trajectory
from solvers.transcription.multi_arc import MultiArc

Vector = NDArray[np.float64]

TOLERANCE = 5e-9
"""What the error of the states between nodes should be, relative to each state's scale."""

DRIFT = 1e-6
"""How far the Hamiltonian may wander, relative to the magnitude of its terms."""

# An arc of this part of the horizon does not vanish.
_FIRM = 0.02
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

    def good_within(self, tolerance: float) -> bool:
        """Whether states, bounds and path constraints are within a tolerance between nodes."""
        return max(self.error, self.outside) <= tolerance

    def is_certain(self, tolerance: float) -> bool:
        """Whether limits are held within a tolerance, and the Hamiltonian is as constant as it must be."""
        drifts = [part.solved.hamiltonian_drift for part in self.parts]
        return self.outside <= tolerance and all(drift is None or drift <= DRIFT for drift in drifts)

    @property
    def wrong_sign(self) -> float:
        """The largest wrong value of a switching function."""
        return max(part.wrong_sign for part in self.parts)

    @property
    def pattern(self) -> Hashable:
        """What is the same for structures that differ in instants only."""
        return pattern_of([part.structure for part in self.parts])


def pattern_of(structures: Sequence[Structure]) -> Hashable:
    """What is the same for structures that differ in instants only, part by part."""
    return tuple(structure.pattern for structure in structures)


def assessed(solved: Ended, arcs: Sequence[Arcs]) -> tuple[Refined[Ended], Sequence[Structure | None] | None]:
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
