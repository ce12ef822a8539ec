"""The search for the true structure: multi-arc problems, changed until Pontryagin's conditions hold.

Arcs that shrink to nothing are dropped, arcs on which the switching function or the multiplier of a limit
has the wrong sign are cut, and where a free control comes to rest on a bound a new arc begins. Then nodes are
added until the dynamics hold between them.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solvers.certificate import hamiltonian_drift
from solvers.mesh_points import spline_mesh
from solvers.problem import OptimalControlProblem
from solvers.refine.detection import find_structure
from solvers.refine.mesh import ArcMesh, first_mesh
from solvers.refine.residual import arc_errors
from solvers.refine.signs import next_structure
from solvers.refine.structure import Structure
from solvers.session import Session, Solved
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.transcription.multi_arc import MultiArc
from solvers.transcription.spline_wavelet import SplineWavelet

Vector = NDArray[np.float64]

PROGRAM_TOLERANCE = 1e-12
"""How exactly multi-arc programs are solved: switching times enter the objective squared, a singular control
more weakly still, so that they are as good as the square root of this."""

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
# After so many rounds of more nodes, none of which halves the error, the best of structures that take turns
# is taken for a wrong one.
_PATIENCE = 2
# Where the arcs that were found reach no target: splines on this mesh, next time one level finer. They let a
# control jump from knot to knot, where polynomials of higher degree chatter along limits.
LOOKS = 2
_LOOK_LENGTH, _LOOK_LEVEL = 8, 6
# The part of what the Hamiltonian may wander that more nodes aim at.
_DRIFT_AIM = 0.1
# An arc is cut where the sign is wrong by more than this, and by more than the error of the states.
_CUT = 1e-6


@dataclass(frozen=True)
class Refined:
    """A solved multi-arc problem with its structure and mesh.

    ``errors``: of the states, segment by segment; ``wrong_sign``: the largest wrong value of a switching
    function; both relative.
    """

    solved: Solved
    structure: Structure
    mesh: ArcMesh
    errors: Vector
    wrong_sign: float

    @property
    def error(self) -> float:
        """The largest of the errors."""
        return float(self.errors.max())


@dataclass
class Search:
    """Goes from structure to structure; keeps the patterns that it has tried and the best that it found."""

    session: Session
    start: Trajectory
    tried: set[Hashable] = field(default_factory=set)
    best: Refined | None = None
    stopped: SolveStatus | None = None
    looks: int = 0

    def run(self, structure: Structure) -> str:
        """Search from ``structure``; returns why it ended."""
        problem, start, settled = self.session.problem, self.start, False
        mesh = self._first_mesh(start, structure)
        before, slow = np.inf, 0
        for round_ in range(_ROUNDS):
            solved = (
                None if _too_few_arcs(problem, structure) else self._solve(structure, mesh, start, round_)
            )
            if solved is None or not solved.converged:
                if solved is not None and solved.stopped:
                    self.stopped = solved.outcome.status
                    return "it was stopped"
                closer = self._look_closer(start, round_) if self.best is None else None
                if closer is None:
                    return (
                        "the arcs are too few"
                        if solved is None
                        else f"the program ended {solved.outcome.status}"
                    )
                structure, start = closer
                mesh = self._first_mesh(start, structure)
                continue
            program, start = solved.transcription, solved.trajectory
            assert isinstance(program, MultiArc)
            structure = replace(structure, edges=program.edges_of(start))
            errors = program.by_segment(arc_errors(problem, start).states.max(axis=0))
            wrong_sign, changed = next_structure(problem, solved, structure, max(_CUT, float(errors.max())))
            if errors.max() <= TOLERANCE:
                errors = np.maximum(errors, _wander(solved))
            if wrong_sign <= WRONG_SIGN:
                self._keep(Refined(solved, structure, mesh, errors, wrong_sign))
            if changed is not None and not settled:
                if changed.pattern not in self.tried:
                    structure, mesh = changed, self._first_mesh(start, changed)
                    continue
                # Structures take turns, or switches accumulate: the best so far, with nodes enough.
                if self.best is None:
                    return "the same structures come back"
                settled, structure, mesh = True, self.best.structure, self.best.mesh
                start, errors = self.best.solved.trajectory, self.best.errors
            if errors.max() <= TOLERANCE:
                return "done"
            slow = slow + 1 if settled and errors.max() > before / 2.0 else 0
            before = float(errors.max())
            closer = self._look_closer(start, round_) if slow == _PATIENCE and before > ACCEPTABLE else None
            if closer is not None:
                structure, start = closer
                mesh, settled, before = self._first_mesh(start, structure), False, np.inf
                continue
            mesh = mesh.refined(start, errors, TOLERANCE)
        return f"no structure was settled on after {_ROUNDS} rounds"

    def _look_closer(self, start: Trajectory, round_: int) -> tuple[Structure, Trajectory] | None:
        """The structure of an answer on a finer mesh, and that answer; None after some attempts.

        A mesh does not see arcs shorter than its intervals, and bang arcs that are too few reach no target.
        """
        if self.looks == LOOKS:
            return None
        problem, level = self.session.problem, _LOOK_LEVEL + self.looks
        self.looks += 1
        self.session.barrier = None
        knots = spline_mesh(problem, _LOOK_LENGTH, level)
        adaptive = knots.finest > level
        transcription = SplineWavelet(problem, self.session.scaling, start, knots, adaptive=adaptive)
        solved = self.session.solve(transcription, f"switching {round_ + 1}", _share(round_), warm=True)
        self.stopped = solved.outcome.status if solved.stopped else None
        return (structure_of(solved), solved.trajectory) if solved.converged else None

    def _first_mesh(self, start: Trajectory, structure: Structure) -> ArcMesh:
        self.tried.add(structure.pattern)
        return first_mesh(self.session.problem, start, structure)

    def _solve(self, structure: Structure, mesh: ArcMesh, start: Trajectory, round_: int) -> Solved:
        transcription = arcs_program(self.session, structure, mesh, start)
        # Without free controls, and with arcs that are there to stay, there is no bound to stay away from:
        # three steps of Newton's method.
        firm = not structure.is_free and np.diff(structure.edges).min() >= _FIRM
        self.session.barrier = _NO_BARRIER if firm else None
        return self.session.solve(transcription, f"switching {round_ + 1}", _share(round_), warm=True)

    def _keep(self, found: Refined) -> None:
        """Keep the better one: of one pattern that of smaller error, else that of the smaller objective.

        What may become the answer is better than what may not.
        """
        best = self.best
        if best is None or best.structure.pattern == found.structure.pattern:
            better = best is None or found.error < best.error
        else:
            ranks = [(item.error > ACCEPTABLE, item.solved.objective) for item in (found, best)]
            better = ranks[0] < ranks[1]
        if better:
            self.best = found


def arcs_program(session: Session, structure: Structure, mesh: ArcMesh, start: Trajectory) -> MultiArc:
    """The multi-arc problem of a structure, to be solved from ``start``."""
    return MultiArc(
        session.problem,
        session.scaling,
        start,
        mesh.breaks(structure.edges),
        mesh.flat_counts,
        mesh.parts,
        structure.pinned,
        structure.follows(session.problem, start),
    )


def structure_of(solved: Solved) -> Structure:
    """The structure of a solved mesh."""
    return find_structure(
        solved.weighted_problem,
        solved.trajectory,
        lambda: solved.transcription.costates(solved.trajectory, solved.outcome.row_multipliers),
    )


def _wander(solved: Solved) -> float:
    """What the Hamiltonian says of all segments: 0 where it is constant enough, else as an error of states.

    States may be right between the nodes for whatever control is flown: x' = u is. The control is the best
    one only where the Hamiltonian is constant.
    """
    costates = solved.transcription.costates(solved.trajectory, solved.outcome.row_multipliers)
    drift = hamiltonian_drift(solved.weighted_problem, solved.trajectory, costates)
    return 0.0 if drift is None or drift <= DRIFT else TOLERANCE * drift / (_DRIFT_AIM * DRIFT)


def _share(round_: int) -> tuple[float, float]:
    """The part of all work that a round is: nobody knows how many will follow."""
    return 1.0 - 0.5 ** (round_ + 1), 1.0 - 0.5 ** (round_ + 2)


def _too_few_arcs(problem: OptimalControlProblem, structure: Structure) -> bool:
    """Whether arcs that leave nothing free have fewer unknown times than there are conditions on them."""
    if not structure.is_decided:
        return False
    free = [bounds[0] < bounds[1] for bounds in (problem.initial_time, problem.final_time)]
    free += [bounds[0] < bounds[1] for bounds in problem.initial_state]
    free += [item.interval[0] < item.interval[1] for item in problem.design]
    held = [bounds[0] == bounds[1] for bounds in problem.final_state]
    held += [item.interval[0] == item.interval[1] for item in problem.boundary]
    held += [item.interval[0] == item.interval[1] for item in problem.integrals]
    return structure.arcs - 1 + sum(free) < sum(held) + structure.entry_conditions
