"""Switching refinement: from an answer on a mesh to its true structure, with the switching times as unknowns.

Arcs are read off the answer, solved as a multi-arc problem, and changed until the conditions of Pontryagin's
principle hold: along an arc on the lower bound the switching function dH/du is not negative, on the upper one
not positive; arcs that shrink to nothing are dropped, arcs on which the sign is wrong are cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.certificate import switching_functions
from solvers.problem import OptimalControlProblem
from solvers.refine.structure import Structure, find_structure
from solvers.session import Session, Solved
from solvers.trajectory import Trajectory
from solvers.transcription.multi_arc import MultiArc

Vector = NDArray[np.float64]

TOLERANCE = 1e-9
"""What the residual of the dynamics between nodes may be, relative to each state's scale."""

_ROUNDS = 10
_FEWEST_NODES = 8
_MOST_NODES = 100
# A first number of nodes for each node of the mesh that the answer came from.
_NODES_SHARE = 0.35
_MORE_NODES = 1.4
# A wrong sign counts beyond this part of the largest value of a switching function.
_WRONG_SIGN = 1e-3
# The objective may not get worse by more than this part of itself.
_WORSE = 1e-3


@dataclass(frozen=True)
class Refinement:
    """The refined answer, or None and ``reason``, why the first one stays."""

    solved: Solved | None
    reason: str = ""


def refine_switching(session: Session, first: Solved) -> Refinement:
    """Find the structure of a converged answer and solve for its switching times.

    Raises whatever the progress of the session raises.
    """
    problem = session.problem
    structure = find_structure(problem, first.trajectory)
    counts = _first_counts(structure, first.trajectory)
    start = first.trajectory
    for round_ in range(_ROUNDS):
        transcription = MultiArc(
            problem, session.scaling, start, structure.breaks, tuple(counts), structure.pinned
        )
        solved = session.solve(transcription, f"switching {round_ + 1}", (0.5, 1.0), warm=True)
        if not solved.converged:
            return Refinement(None, f"the multi-arc problem ended {solved.outcome.status.value}")
        start = solved.trajectory
        found = Structure(np.array(start.basis["breaks"]), structure.pinned)
        reduced = found.without_empty_arcs()
        changed = _cut_wrong_signs(problem, solved, reduced) if reduced.arcs == found.arcs else reduced
        if changed is not reduced or reduced.arcs != found.arcs:
            structure, counts = changed, _first_counts(changed, first.trajectory)
            continue
        structure = found
        residual = arc_residuals(problem, start)
        coarse = residual > TOLERANCE
        if not coarse.any():
            return _judged(first, solved)
        if np.all(np.array(counts)[coarse] >= _MOST_NODES):
            return Refinement(
                None, f"the residual stays at {residual.max():.1e} with {_MOST_NODES} nodes an arc"
            )
        counts = [
            min(_MOST_NODES, int(np.ceil(count * _MORE_NODES))) if more else count
            for count, more in zip(counts, coarse, strict=True)
        ]
    return Refinement(None, f"no structure was settled on after {_ROUNDS} rounds")


def arc_residuals(problem: OptimalControlProblem, trajectory: Trajectory) -> Vector:
    """For each segment the largest residual of the dynamics between nodes, times the segment's length.

    Relative to each state's scale: about the error of the states at the end of the segment.
    """
    breaks, counts = np.array(trajectory.basis["breaks"]), trajectory.basis["nodes"]
    scale = np.maximum(1e-6, np.abs(trajectory.states_at(trajectory.nodes)).max(axis=1))
    residuals = []
    for start, stop, count in zip(breaks[:-1], breaks[1:], counts, strict=True):
        tau = start + (stop - start) * (np.arange(2 * count) + 0.5) / (2 * count)
        gap = trajectory.rates_at(tau) - problem.rates_at(trajectory, tau)
        residuals.append(float(np.max(np.abs(gap) / scale[:, None]) * (stop - start) * trajectory.duration))
    return np.array(residuals)


def _first_counts(structure: Structure, trajectory: Trajectory) -> list[int]:
    """Nodes for each arc, from how many the mesh of the first answer spent there."""
    spent, _ = np.histogram(trajectory.nodes, structure.breaks)
    return [int(count) for count in np.clip(np.ceil(_NODES_SHARE * spent), _FEWEST_NODES, _MOST_NODES)]


def _cut_wrong_signs(problem: OptimalControlProblem, solved: Solved, structure: Structure) -> Structure:
    """Cut the first arc on which a switching function has the wrong sign, where it changes it."""
    costates = solved.transcription.costates(solved.trajectory, solved.outcome.row_multipliers)
    tau, functions = solved.trajectory.nodes, switching_functions(problem, solved.trajectory, costates)
    for index, (name, pinned) in enumerate(structure.pinned.items()):
        values = functions[index]
        limit = _WRONG_SIGN * np.max(np.abs(values))
        lower, upper = problem.control_bounds[index]
        for arc, level in enumerate(pinned):
            here = np.flatnonzero((tau >= structure.breaks[arc]) & (tau <= structure.breaks[arc + 1]))[1:-1]
            sign = 1.0 if level == upper else -1.0
            wrong = sign * values[here] > limit
            if np.isnan(level) or not wrong.any():
                continue
            edges = np.flatnonzero(wrong[1:] != wrong[:-1])
            instants = (tau[here][edges] + tau[here][edges + 1]) / 2.0
            first = lower + upper - level if wrong[0] else level
            levels = np.where(np.arange(edges.size + 1) % 2 == 0, first, lower + upper - first)
            return structure.split(name, arc, instants, levels)
    return structure


def _judged(first: Solved, refined: Solved) -> Refinement:
    worse = refined.objective - first.objective
    if worse > _WORSE * max(abs(first.objective), 1e-6):
        return Refinement(None, f"the objective would get worse by {worse:.1e}")
    return Refinement(refined)
