"""How far every bound and constraint of the document is from being active, for the design review."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.formulation.quantities import Constraint, Integral, Interval, Total
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.verification.violations import SMALLEST_SCALE, dense

Vector = NDArray[np.float64]

# Within this part of its own scale of a bound, a quantity counts as resting on it.
_ACTIVE = 1e-3


class Quantity(NamedTuple):
    """What may have bounds: where these stand, its name, its values and their times."""

    pointer: str
    name: str
    values: Vector
    interval: Interval
    times: Vector


def constraint_margins(
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    integrals: Mapping[str, float],
    place: Callable[[str], str],
) -> list[dict[str, Any]]:
    """The ``constraints`` of a result: extremes, smallest margin and where, and when each is active.

    A negative margin is a violation. Sampled between the breakpoints of the trajectory; what is said of the
    ends, of times and of design parameters has one value. ``integrals`` are those of the answer, by name;
    ``place``: where in the document stands what is at a pointer of the problem.
    """
    found = chain(_along(problem, trajectory), _at_the_ends(problem, trajectory, integrals))
    return [{**item, "pointer": place(item["pointer"])} for item in margins_of(found)]


def margins_of(quantities: Iterable[Quantity]) -> Iterator[dict[str, Any]]:
    """The margins of those that have bounds and values."""
    for quantity in quantities:
        if np.isfinite(quantity.interval).any() and quantity.values.size:
            yield _margin(quantity)


def merged_margins(margins: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Margins of which those at one place of the document, as of several phases, are one."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for item in margins:
        known = found.setdefault((item["pointer"], item["name"]), item)
        if known is item:
            continue
        nearer = item if item["margin"] < known["margin"] else known
        known |= {
            "min": min(known["min"], item["min"]),
            "max": max(known["max"], item["max"]),
            "margin": nearer["margin"],
            "at": nearer["at"],
            "active": [*known["active"], *item["active"]],
        }
    return list(found.values())


def said_of_the_ends(
    boundary: Iterable[Constraint], integrals: Iterable[Integral | Total], scope: Mapping[str, Any], tf: float
) -> Iterator[Quantity]:
    """Boundary constraints and integrals, whose values are known at the end; ``scope`` names both ends."""
    at = np.array([tf])
    for constraint in boundary:
        with np.errstate(all="ignore"):
            value = np.array([constraint.expression.evaluate(scope, NUMPY.functions)], np.float64)
        yield Quantity(constraint.pointer, constraint.name, value, constraint.interval, at)
    for item in integrals:
        yield Quantity(item.pointer, item.name, np.array([scope[item.name]], np.float64), item.interval, at)


def _along(problem: OptimalControlProblem, trajectory: Trajectory) -> Iterator[Quantity]:
    """Every quantity along the trajectory that may have bounds."""
    tau = dense(trajectory.breakpoints)
    times = trajectory.time(tau)
    states, controls = trajectory.states_at(tau), trajectory.controls_at(tau)
    for names, bounds, values in (
        (problem.states, problem.state_bounds, states),
        (problem.controls, problem.control_bounds, controls),
    ):
        for name, interval, row in zip(names, bounds, values, strict=True):
            yield Quantity(problem.bound_pointer(name), name, row, interval, times)
    scope = problem.scope(states, controls, times, problem.parameters_of(trajectory), NUMPY)
    for constraint in problem.path:
        with np.errstate(all="ignore"):
            value = np.asarray(constraint.expression.evaluate(scope, NUMPY.functions), np.float64)
        held = constraint.holds_at(tau)
        row = np.broadcast_to(value, tau.shape)[held]
        yield Quantity(constraint.pointer, constraint.name, row, constraint.interval, times[held])


def _at_the_ends(
    problem: OptimalControlProblem, trajectory: Trajectory, integrals: Mapping[str, float]
) -> Iterator[Quantity]:
    """Ends of states and controls that have room, times, design parameters, what is said of both ends."""
    edges = np.array([0.0, 1.0])
    (begin, end), (first, last) = trajectory.states_at(edges).T, trajectory.controls_at(edges).T
    t0, tf = trajectory.time(edges)
    of_states, of_controls = (problem.states, "state"), (problem.controls, "control")
    for (names, what), edge, bounds, values, time in (
        (of_states, "initial", problem.initial_state, begin, t0),
        (of_states, "final", problem.final_state, end, tf),
        (of_controls, "initial", problem.initial_control, first, t0),
        (of_controls, "final", problem.final_control, last, tf),
    ):
        for name, interval, value in zip(names, bounds, values, strict=True):
            key = f"{edge}_control" if name in problem.rated else f"{edge}_{what}"
            suffix = "_0" if edge == "initial" else "_f"
            yield from _with_room(f"/problem/{key}/{name}", name + suffix, value, interval, time)
    yield from _with_room("/problem/initial_time", "t0", t0, problem.initial_time, t0)
    yield from _with_room("/problem/final_time", "tf", tf, problem.final_time, tf)
    for item in problem.design:
        value = trajectory.design[item.name]
        yield from _with_room(f"/problem/design/{item.name}", item.name, value, item.interval, tf)
    scope = problem.ends_scope(
        (begin, first, t0),
        (end, last, tf),
        problem.parameters_of(trajectory),
        NUMPY,
        [integrals.get(item.name, np.nan) for item in problem.integrals],
    )
    yield from said_of_the_ends(problem.boundary, problem.integrals, scope, tf)


def _with_room(pointer: str, name: str, value: float, interval: Interval, time: float) -> Iterator[Quantity]:
    """What is one number, where that is not given."""
    if interval[0] < interval[1]:
        yield Quantity(pointer, name, np.array([value]), interval, np.array([time]))


def _margin(quantity: Quantity) -> dict[str, Any]:
    (lower, upper), values, times = quantity.interval, quantity.values, quantity.times
    room = np.minimum(values - lower, upper - values)
    nearest = int(np.argmin(room))
    scale = max(SMALLEST_SCALE, float(np.max(np.abs(values))))
    if values.size == 1:  # one number near 0 says nothing of how large it may be
        scale = max(scale, *(abs(bound) for bound in quantity.interval if np.isfinite(bound)))
    return {
        "pointer": quantity.pointer,
        "name": quantity.name,
        "min": float(values.min()),
        "max": float(values.max()),
        "bounds": [bound if np.isfinite(bound) else None for bound in quantity.interval],
        "margin": float(room[nearest]),
        "at": float(times[nearest]),
        "active": _stretches(room <= _ACTIVE * scale, times),
    }


def _stretches(active: NDArray[np.bool_], times: Vector) -> list[list[float]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], active.astype(np.int8), [0]])))
    return [[float(times[start]), float(times[stop - 1])] for start, stop in edges.reshape(-1, 2)]
