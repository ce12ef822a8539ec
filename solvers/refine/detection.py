"""Reads the structure off an answer on any mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from solvers.certificate import switching_functions
from solvers.limits import Limit, limits_of
from solvers.problem import OptimalControlProblem
from solvers.refine.structure import SHORTEST_ARC, Flags, Pieces, Structure, distinct, present
from solvers.switching import SHORTEST_INTERIOR, control_arcs, inside, switch_instants
from solvers.trajectory import Trajectory
from solvers.transcription.limit_rates import LimitRates, limit_rates

Vector = NDArray[np.float64]

# A limit is active at a sample within this part of the quantity's own range. A stretch may leave it by _NEAR
# in between, where a mesh follows it loosely, and miss _GAP samples; one of fewer samples is a touch.
_ACTIVE = 1e-5
_NEAR = 1e-3
_GAP = 3
_SHORTEST_STRETCH = 4
# A control jumps by more than this part of its own range.
_JUMP = 1e-3


def find_structure(
    problem: OptimalControlProblem, trajectory: Trajectory, costates: Callable[[], Vector] | None = None
) -> Structure:
    """Read arcs off an answer: from its controls, from their switching functions, from limits that it meets.

    ``costates`` gives those of the answer; they are asked for only where a control is inside its bounds. An
    answer whose structure was refined needs none: its controls do not chatter.
    """
    stretches = _stretches(problem, trajectory)
    rates = {limit: found for limit in stretches if (found := limit_rates(problem, limit)) is not None}
    held = _held(problem, trajectory.nodes, stretches, rates)
    controls = _control_pieces(problem, trajectory, costates, held)
    instants = [item.instants for item in controls.values()] + [item.ravel() for item in stretches.values()]
    edges = distinct(np.concatenate([np.zeros(0), *instants]))
    middles = (edges[1:] + edges[:-1]) / 2.0
    followed, touched = {}, {}
    for limit, item in rates.items():
        start, stop = stretches[limit][:, :1], stretches[limit][:, 1:]
        followed[limit] = np.any((start < middles) & (middles < stop), axis=0)
        if item.order:
            met = (start == stop) & (np.abs(start - edges[:-1]) <= SHORTEST_ARC)
            touched[limit] = np.any(met, axis=0) & (np.arange(middles.size) > 0)
    pinned = {name: pieces.at(edges) for name, pieces in controls.items()}
    nodes = np.diff(np.searchsorted(trajectory.nodes, edges))
    followed = _reaching(problem, nodes, pinned, followed, rates)
    return Structure(edges, pinned, present(followed), present(touched), rates).decided(problem)


def _reaching(
    problem: OptimalControlProblem,
    nodes: NDArray[np.intp],
    pinned: Mapping[str, Vector],
    followed: Mapping[Limit, Flags],
    rates: Mapping[Limit, LimitRates],
) -> dict[Limit, Flags]:
    """Limits followed from and to where the controls that they decide leave their bounds.

    A few of the ``nodes`` of an arc between the two are the switch seen through the mesh, no free arc.
    """
    found = dict[Limit, Flags]()
    for limit, flags in followed.items():
        names = [problem.controls[index] for index in rates[limit].controls]
        free = np.any([np.isnan(pinned[name]) for name in names], axis=0)
        between = _beside(flags, -1) & _beside(~free, 1) | _beside(flags, 1) & _beside(~free, -1)
        found[limit] = flags | (free & between & (nodes < SHORTEST_INTERIOR))
    return found


def _beside(flags: Flags, step: int) -> Flags:
    """For each arc the flag of the one before it (``step`` -1) or after it (1); False where there is none."""
    return np.append(flags[1:], False) if step > 0 else np.append(False, flags[:-1])


def _held(
    problem: OptimalControlProblem,
    tau: Vector,
    stretches: Mapping[Limit, Vector],
    rates: Mapping[Limit, LimitRates],
) -> NDArray[np.bool_]:
    """At which of K instants each control is decided by a limit, (m, K)."""
    held = np.zeros((len(problem.controls), tau.size), bool)
    for limit, item in rates.items():
        start, stop = stretches[limit][:, :1], stretches[limit][:, 1:]
        held[list(item.controls)] |= np.any((start <= tau) & (tau <= stop), axis=0)
    return held


def _control_pieces(
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    costates: Callable[[], Vector] | None,
    held: NDArray[np.bool_],
) -> dict[str, Pieces]:
    """Where each control rests on which bound; ``held``: see :func:`_held`."""
    tau, strengths, found = trajectory.nodes, None, {}
    for index, (name, bounds) in enumerate(zip(problem.controls, problem.control_bounds, strict=True)):
        values = trajectory.controls[name](tau)
        arcs = control_arcs(values, bounds)
        if costates and len(arcs) > 1 and inside(values, bounds).sum() >= SHORTEST_INTERIOR:
            if strengths is None:
                strengths = _strengths(switching_functions(problem, trajectory, costates()))
            arcs = control_arcs(values, bounds, strengths[index], held[index])
        levels = [arc.level(bounds) for arc in arcs]
        instants = switch_instants(tau, values, bounds, arcs)
        found[name] = Pieces(
            instants if costates else _at_jumps(trajectory, name, instants),
            np.array([np.nan if level is None else level for level in levels]),
        )
    return found


def _at_jumps(trajectory: Trajectory, control: str, instants: Vector) -> Vector:
    """The instants, and where the control jumps between the same two nodes, that instant in its place.

    Between its nodes an answer whose structure was refined knows better than they do where it switches.
    """
    curve, breaks = trajectory.controls[control], trajectory.breakpoints[1:-1]
    heights = np.abs(curve(breaks) - curve(np.nextafter(breaks, 0.0)))
    jumps = breaks[heights > _JUMP * np.ptp(curve(trajectory.nodes))]
    between = np.searchsorted(trajectory.nodes, jumps)
    moved = instants.copy()
    for index, place in enumerate(np.searchsorted(trajectory.nodes, instants)):
        found = jumps[between == place]
        if found.size == 1:
            moved[index] = found[0]
    return moved


def _stretches(problem: OptimalControlProblem, trajectory: Trajectory) -> dict[Limit, Vector]:
    """The active stretches of every limit that has any."""
    found = {limit: active_stretches(problem, trajectory, limit) for limit in limits_of(problem)}
    return {limit: stretches for limit, stretches in found.items() if stretches.size}


def active_stretches(problem: OptimalControlProblem, trajectory: Trajectory, limit: Limit) -> Vector:
    """Where a limit is active: start and end of every stretch, normalised, (stretches, 2); equal for a touch.

    An end condition that holds the trajectory on the limit is no stretch of its own.
    """
    tau = trajectory.breakpoints if limit.path is None else trajectory.nodes
    room = limit.room(problem, trajectory, tau)
    own_range = max(float(np.ptp(room)), 1e-9)
    near = np.flatnonzero(room <= _NEAR * own_range)
    found = []
    for run in np.split(near, np.flatnonzero(np.diff(near) > _GAP) + 1):
        active = run[room[run] <= _ACTIVE * own_range]
        if not active.size:
            continue
        if active[-1] - active[0] + 1 >= _SHORTEST_STRETCH:
            found.append((tau[active[0]], tau[active[-1]]))
        elif active[0] > 0 and active[-1] < tau.size - 1:
            deepest = tau[active[np.argmin(room[active])]]
            found.append((deepest, deepest))
    return np.array(found).reshape(-1, 2)


def _strengths(functions: Vector) -> Vector:
    """Magnitudes relative to the largest of each row."""
    magnitude = np.abs(functions)
    largest = magnitude.max(axis=1, keepdims=True)
    return np.asarray(magnitude / np.maximum(largest, np.finfo(float).tiny), np.float64)
