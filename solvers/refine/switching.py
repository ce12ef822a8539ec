"""Switching refinement: from an answer on a mesh to its true structure, with the switching times as unknowns.

Arcs are read off the answer, solved as a multi-arc problem, and changed until Pontryagin's conditions hold:
along an arc on the lower bound the switching function dH/du is not negative, on the upper one not positive.
Arcs that shrink to nothing are dropped, arcs on which the sign is wrong are cut, and where a free control
comes to rest on a bound a new arc begins. Then nodes are added until the dynamics hold between them.
"""

from __future__ import annotations

import time
from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.optimizers.ipopt import WARM_BARRIER
from solvers.problem import Interval, OptimalControlProblem
from solvers.refine.detection import find_structure
from solvers.refine.mesh import ArcMesh, first_mesh
from solvers.refine.residual import arc_errors, mesh_error_estimate
from solvers.refine.structure import Pieces, Structure
from solvers.session import Session, Solved
from solvers.status import SolveStatus
from solvers.switching import find_switching
from solvers.trajectory import Trajectory
from solvers.transcription.multi_arc import MultiArc
from solvers.verify import Check, Verification

Vector = NDArray[np.float64]

TOLERANCE = 5e-9
"""What the error of the states between nodes should be, relative to each state's scale."""

ACCEPTABLE = 1e-7
"""What it may be where more nodes do not bring it below the tolerance."""

DRIFT = 1e-6
"""How far the Hamiltonian may wander, relative to the magnitude of its terms."""

WRONG_SIGN = 1e-3
"""The largest wrong value of a switching function that is accepted, relative to its largest value.

It is left where switches accumulate or structures would take turns.
"""

# Switching times enter the objective squared, and a singular control more weakly still: they are as good as
# the square root of this.
_PROGRAM_TOLERANCE = 1e-12
# Where IPOPT ends for this tolerance.
_NO_BARRIER = _PROGRAM_TOLERANCE / 11.0
# An arc of this part of the horizon does not vanish.
_FIRM = 0.02
_ROUNDS = 16
# An arc is cut where the sign is wrong by more than this, and by more than the error of the states.
_CUT = 1e-6
# A free control rests on a bound within this part of its range, for so many nodes.
_RESTS = 1e-6
_SHORTEST_REST = 2
# The objective may not get worse by more than this part of itself, or than the error of the first answer.
_WORSE = 1e-3


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


@dataclass(frozen=True)
class Refinement:
    """The refined answer, or the first one and why it stays."""

    solved: Solved
    refined: Refined | None
    reason: str

    @property
    def summary(self) -> dict[str, Any]:
        """What was done, for the ``method`` of the result; ``refine`` is None if the first answer stays."""
        if self.refined is None:
            return {"refine": None}
        counts = [list(counts) for counts in self.refined.mesh.counts]
        return {"refine": "switching", "arcs": len(counts), "arc_nodes": counts}

    @property
    def warnings(self) -> list[dict[str, str]]:
        """Why the first answer stays, if it does."""
        if self.refined is not None:
            return []
        return [{"code": "refinement_failed", "pointer": "/method/refine", "detail": self.reason}]

    def switching(self, problem: OptimalControlProblem) -> dict[str, Any]:
        """The ``switching`` of the result."""
        if self.refined is None:
            return find_switching(problem, self.solved.trajectory)
        return self.refined.structure.switching(problem, self.solved.trajectory)

    def certified(self, problem: OptimalControlProblem, verification: Verification) -> Verification:
        """The verification with what else a refined answer must show: its signs, its Hamiltonian."""
        if self.refined is None:
            return verification
        checks = [Check("switching_sign", self.refined.wrong_sign, WRONG_SIGN)]
        if verification.hamiltonian_drift is not None:
            checks.append(Check("hamiltonian_drift", verification.hamiltonian_drift, DRIFT))
        return replace(
            verification,
            checks=(*verification.checks, *checks),
            mesh_error_estimate=mesh_error_estimate(problem, self.solved.trajectory),
        )


def refine_switching(session: Session, first: Solved) -> Refinement:
    """Find the structure of a converged answer and solve for its switching times.

    Raises whatever the progress of the session raises.
    """
    started = time.perf_counter()
    inner = replace(
        session, tolerance=min(session.tolerance, _PROGRAM_TOLERANCE), seconds={"build": 0.0, "solve": 0.0}
    )
    structure = find_structure(
        session.problem,
        first.trajectory,
        lambda: first.transcription.costates(first.trajectory, first.outcome.row_multipliers),
    )
    search = _Search(inner, first)
    reason = search.run(structure)
    session.iterations = inner.iterations
    session.seconds["refine"] = time.perf_counter() - started
    return search.judged(reason)


@dataclass
class _Search:
    """Goes from structure to structure; keeps the patterns that it has tried and the best that it found."""

    session: Session
    first: Solved
    tried: set[Hashable] = field(default_factory=set)
    best: Refined | None = None
    stopped: SolveStatus | None = None

    def run(self, structure: Structure) -> str:
        """Search from ``structure``; returns why it ended."""
        problem, start = self.session.problem, self.first.trajectory
        mesh, settled = self._first_mesh(start, structure), False
        for round_ in range(_ROUNDS):
            solved = self._solve(structure, mesh, start, round_)
            if not solved.converged:
                self.stopped = solved.outcome.status if solved.stopped else None
                return f"the multi-arc problem ended {solved.outcome.status.value}"
            program, start = solved.transcription, solved.trajectory
            assert isinstance(program, MultiArc)
            structure = replace(structure, edges=program.edges_of(start))
            errors = program.by_segment(arc_errors(problem, start).states.max(axis=0))
            wrong_sign, changed = _next_structure(problem, solved, structure, max(_CUT, float(errors.max())))
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
            mesh = mesh.refined(start, errors, TOLERANCE)
        return f"no structure was settled on after {_ROUNDS} rounds"

    def judged(self, reason: str) -> Refinement:
        """The best that was found, if it may replace the first answer."""
        best = None if self.stopped else self.best
        if best is None:
            return self._stays(reason)
        if best.error > ACCEPTABLE:
            return self._stays(f"the states between nodes are wrong by {best.error:.1e}; {reason}")
        worse = best.solved.objective - self.first.objective
        size = max(abs(self.first.objective), abs(best.solved.objective), 1e-6)
        if worse > _WORSE * size and worse > self._doubt * size:
            return self._stays(f"the objective would get worse by {worse:.1e}")
        return Refinement(best.solved, best, reason)

    @property
    def _doubt(self) -> float:
        """How wrong the states of the first answer are between nodes, relative."""
        return float(arc_errors(self.session.problem, self.first.trajectory).states.max())

    def _stays(self, reason: str) -> Refinement:
        """The first answer; stopped, where somebody or the clock asked to stop."""
        status = self.first.outcome.status if self.stopped is None else self.stopped
        outcome = replace(self.first.outcome, status=status)
        return Refinement(replace(self.first, outcome=outcome), None, reason)

    def _first_mesh(self, start: Trajectory, structure: Structure) -> ArcMesh:
        self.tried.add(structure.pattern)
        return first_mesh(self.session.problem, start, structure)

    def _solve(self, structure: Structure, mesh: ArcMesh, start: Trajectory, round_: int) -> Solved:
        transcription = MultiArc(
            self.session.problem,
            self.session.scaling,
            start,
            mesh.breaks(structure.edges),
            mesh.flat_counts,
            mesh.parts,
            structure.pinned,
            structure.follows(self.session.problem, start),
        )
        # Without free controls, and with arcs that are there to stay, there is no bound to stay away from:
        # three steps of Newton's method.
        firm = not structure.is_free and np.diff(structure.edges).min() >= _FIRM
        self.session.barrier = _NO_BARRIER if firm else WARM_BARRIER
        share = 1.0 - 0.5 ** (round_ + 1), 1.0 - 0.5 ** (round_ + 2)
        return self.session.solve(transcription, f"switching {round_ + 1}", share, warm=True)

    def _keep(self, found: Refined) -> None:
        """Keep the better one: of one pattern that of smaller error, else that of the smaller objective."""
        best = self.best
        if best is None or (
            found.error < best.error
            if found.structure.pattern == best.structure.pattern
            else found.solved.objective < best.solved.objective
        ):
            self.best = found


def _next_structure(
    problem: OptimalControlProblem, solved: Solved, structure: Structure, threshold: float
) -> tuple[float, Structure | None]:
    """The largest wrong sign, relative, and what the structure becomes; None where it may stay.

    Signs that are wrong by less than ``threshold`` are right. While arcs vanish nothing is said of signs.
    """
    reduced = structure.without_empty_arcs()
    if reduced.arcs < structure.arcs:
        return np.inf, reduced
    program, trajectory = solved.transcription, solved.trajectory
    assert isinstance(program, MultiArc)
    tau = program.gauss_tau(trajectory)
    controls = trajectory.controls_at(tau)
    functions = program.switching_functions(trajectory, solved.outcome.bound_multipliers)
    largest, changes, cut = 0.0, dict[str, list[Pieces | None]](), False
    for index, (name, levels) in enumerate(structure.pinned.items()):
        bounds = problem.control_bounds[index]
        strength = functions[index] / max(float(np.abs(functions[index]).max()), np.finfo(float).tiny)
        changes[name] = []
        for arc, level in enumerate(levels):
            here = program.arc_of_node == arc
            if np.isnan(level):
                wanted = _rests(controls[index, here], bounds)
            else:
                wrong = strength[here] * (1.0 if level == bounds[1] else -1.0)
                largest = max(largest, float(wrong.max()))
                other = bounds[0] + bounds[1] - level
                wanted = np.where(wrong > threshold, other if np.isfinite(other) else np.nan, level)
            pieces = _pieces(tau[here], wanted)
            stays = pieces.levels.size == 1 and np.array_equal(pieces.levels, [level], equal_nan=True)
            changes[name].append(None if stays else pieces)
            cut |= not stays
    return largest, structure.changed(problem, changes) if cut else None


def _pieces(tau: Vector, wanted: Vector) -> Pieces:
    """A level for each node, as pieces that meet midway between nodes."""
    same = (wanted[1:] == wanted[:-1]) | (np.isnan(wanted[1:]) & np.isnan(wanted[:-1]))
    last = np.flatnonzero(~same)
    return Pieces(0.5 * (tau[last] + tau[last + 1]), wanted[np.concatenate([[0], last + 1])])


def _rests(values: Vector, bounds: Interval) -> Vector:
    """Where a free control rests on a bound for some nodes in a row, that bound; NaN elsewhere."""
    width = bounds[1] - bounds[0]
    margin = _RESTS * (width if np.isfinite(width) else max(float(np.ptp(values)), 1e-6))
    wanted = np.full(values.size, np.nan)
    for bound in bounds:
        near = np.flatnonzero(np.abs(values - bound) <= margin)
        for run in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1):
            if run.size >= _SHORTEST_REST:
                wanted[run] = bound
    return wanted
