"""What the switching functions say of a structure: where an arc is wrong, and what becomes of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solvers.formulation.quantities import Interval
from solvers.limits import Limit
from solvers.problem import OptimalControlProblem
from solvers.refine.structure import Flags, Pieces, Structure
from solvers.solved import Solved
from solvers.trajectory import Trajectory
from solvers.transcription.multi_arc import Follow, MultiArc

Vector = NDArray[np.float64]

# A free control rests on a bound within this part of its range, for so many nodes.
_RESTS = 1e-6
_SHORTEST_REST = 2
# A switching function of this part of the largest one is zero.
_NO_SIGN = 1e-8
# An arc of this part of the horizon, all of it within this part of a limit's own range from it, follows it.
_SHORT = 0.02
_NEAR = 1e-3


def next_structure(
    problem: OptimalControlProblem, solved: Solved, structure: Structure, threshold: float
) -> tuple[float, Structure | None]:
    """The largest wrong sign, relative, and what the structure becomes; None where it may stay.

    Signs that are wrong by less than ``threshold`` are right. While arcs vanish, or a free one turns out to
    follow a limit, nothing is said of signs.
    """
    reduced = structure.without_empty_arcs()
    if reduced.arcs < structure.arcs:
        return np.inf, reduced
    program, trajectory = solved.transcription, solved.trajectory
    assert isinstance(program, MultiArc)
    tau = program.gauss_tau(trajectory)
    following = structure.following(problem, _active(problem, structure, program, trajectory))
    if following.pattern != structure.pattern:
        return np.inf, following
    controls = trajectory.controls_at(tau)
    functions = program.switching_functions(trajectory, solved.outcome.bound_multipliers)
    left, largest = _left_limits(problem, solved, structure, threshold)
    sizes = _sizes(problem, functions)
    changes, cut = dict[str, list[Pieces | None]](), False
    for index, (name, levels) in enumerate(structure.pinned.items()):
        bounds = problem.control_bounds[index]
        strength = functions[index] / sizes[index]
        changes[name] = []
        for arc, level in enumerate(levels):
            here = program.arc_of_node == arc
            if (name, arc) in left:
                changes[name].append(left[name, arc])
                cut = True
                continue
            if np.isnan(level):
                wanted = _rests(controls[index, here], bounds)
            elif bounds[0] == bounds[1]:  # a control that is given, which no sign can move
                wanted = np.full(np.count_nonzero(here), level)
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


def _sizes(problem: OptimalControlProblem, functions: Vector) -> Vector:
    """What the switching function (m, K) of each control is compared with, (m,): its largest magnitude.

    Not less than a rounding of what any control moves the Hamiltonian by within its bounds: what is singular
    everywhere has no sign.
    """
    bounds = np.array(problem.control_bounds, np.float64).reshape(-1, 2)
    widths = np.where(np.isfinite(bounds).all(axis=1), bounds[:, 1] - bounds[:, 0], 0.0)
    largest = np.abs(functions).max(axis=1, initial=0.0)
    moved = float(np.max(largest * widths, initial=0.0))
    floor = np.divide(_NO_SIGN * moved, widths, out=np.zeros_like(widths), where=widths > 0.0)
    return np.asarray(np.maximum(np.maximum(largest, floor), np.finfo(float).tiny), np.float64)


def _left_limits(
    problem: OptimalControlProblem, solved: Solved, structure: Structure, threshold: float
) -> tuple[dict[tuple[str, int], Pieces], float]:
    """Where arcs that follow a limit should leave it: by control and arc, in pieces; the largest wrong value.

    With H + nu S' along a limit of order 1, S <= 0, nu must not rise: -nu' is the multiplier of the limit
    itself, and moving the trajectory off the limit where that is negative makes the objective smaller. Where
    one control with two bounds decides, it goes off by the one bound and comes back by the other. Other
    limits are taken as they are.
    """
    program, trajectory = solved.transcription, solved.trajectory
    assert isinstance(program, MultiArc)
    tau, found, largest = program.gauss_tau(trajectory), dict[tuple[str, int], Pieces](), 0.0
    multipliers = program.limit_multipliers(trajectory, solved.outcome.row_multipliers)
    for item, values in zip(program.follows, multipliers, strict=True):
        if item.rates.order != 1 or len(item.rates.controls) != 1 or not values.size:
            continue
        (control,) = item.rates.controls
        two_bounds = bool(np.isfinite(problem.control_bounds[control]).all())
        relative = values / max(float(np.abs(values).max()), np.finfo(float).tiny)
        nodes = program.nodes_following(item)
        for arc in item.arcs:
            here = program.arc_of_node[nodes] == arc
            nu, instants = relative[here] * (1.0 if item.limit.upper else -1.0), tau[nodes[here]]
            rises = [(first, last, nu[last] - nu[first]) for first, last in _rises(nu)]
            largest = max([largest, *(float(rise) for *_, rise in rises)])
            spans = [(instants[first], instants[last]) for first, last, rise in rises if rise > threshold]
            if spans and two_bounds:
                found[problem.controls[control], arc] = _visits(problem, trajectory, item, spans)
    return found, largest


def _rises(values: Vector) -> list[tuple[int, int]]:
    """First and last index of every run of values that rises."""
    rising = np.flatnonzero(np.diff(values) > 0.0)
    runs = np.split(rising, np.flatnonzero(np.diff(rising) > 1) + 1)
    return [(int(run[0]), int(run[-1]) + 1) for run in runs if run.size]


def _visits(
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    item: Follow,
    spans: Sequence[tuple[float, float]],
) -> Pieces:
    """The control that decides a limit which is left in the ``spans``: off by one bound, then back."""
    (control,) = item.rates.controls
    instants, levels = list[float](), [np.nan]
    for start, stop in spans:
        middle = np.full(2, 0.5 * (start + stop))
        controls = trajectory.controls_at(middle)
        controls[control] = problem.control_bounds[control]
        _, slopes = item.rates.along(
            problem.parameters_of(trajectory),
            trajectory.states_at(middle),
            controls,
            trajectory.time(middle),
        )
        off = int(np.argmin(slopes if item.limit.upper else -slopes))
        instants += [start, float(middle[0]), stop]
        levels += [controls[control, off], controls[control, 1 - off], np.nan]
    return Pieces(np.array(instants), np.array(levels))


def _active(
    problem: OptimalControlProblem, structure: Structure, program: MultiArc, trajectory: Trajectory
) -> dict[Limit, Flags]:
    """For each limit that is active somewhere, the short arcs all nodes of which are near it.

    An arc between a bound and a limit that should not be there shrinks, but slowly: it costs nearly nothing.
    """
    tau, found = program.gauss_tau(trajectory), {}
    short = np.diff(structure.edges) <= _SHORT
    for limit in structure.rates:
        room = limit.room(problem, trajectory, tau)
        near = room <= _NEAR * max(float(np.ptp(room)), 1e-9)
        along = [near[program.arc_of_node == arc].all() for arc in range(structure.arcs)]
        found[limit] = short & np.array(along)
    return found


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
