"""How far every bound and constraint of the document is from being active, for the design review."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.problem import OptimalControlProblem
from solvers.quantities import Interval
from solvers.trajectory import Trajectory
from solvers.violations import SMALLEST_SCALE, dense

Vector = NDArray[np.float64]

# Within this part of its own scale of a bound, a quantity counts as resting on it.
_ACTIVE = 1e-3


def constraint_margins(problem: OptimalControlProblem, trajectory: Trajectory) -> list[dict[str, Any]]:
    """The ``constraints`` of a result: extremes, smallest margin and where, and when each is active.

    A negative margin is a violation. Sampled between the breakpoints of the trajectory.
    """
    return [
        _margin(pointer, values, interval, times)
        for pointer, values, interval, times in _quantities(problem, trajectory)
        if np.isfinite(interval).any() and values.size
    ]


def _quantities(
    problem: OptimalControlProblem, trajectory: Trajectory
) -> Iterator[tuple[str, Vector, Interval, Vector]]:
    """Every quantity that may have bounds: its pointer, its values, its bounds, the times of the values."""
    tau = dense(trajectory.breakpoints)
    times = trajectory.time(tau)
    states, controls = trajectory.states_at(tau), trajectory.controls_at(tau)
    for names, bounds, values in (
        (problem.states, problem.state_bounds, states),
        (problem.controls, problem.control_bounds, controls),
    ):
        for name, interval, row in zip(names, bounds, values, strict=True):
            yield problem.bound_pointer(name), row, interval, times
    scope = problem.scope(states, controls, times, problem.parameters_of(trajectory), NUMPY)
    for constraint in problem.path:
        with np.errstate(all="ignore"):
            value = np.asarray(constraint.expression.evaluate(scope, NUMPY.functions), np.float64)
        held = constraint.holds_at(tau)
        yield constraint.pointer, np.broadcast_to(value, tau.shape)[held], constraint.interval, times[held]


def _margin(pointer: str, values: Vector, interval: Interval, times: Vector) -> dict[str, Any]:
    room = np.minimum(values - interval[0], interval[1] - values)
    nearest = int(np.argmin(room))
    scale = max(SMALLEST_SCALE, float(np.max(np.abs(values))))
    return {
        "pointer": pointer,
        "min": float(values.min()),
        "max": float(values.max()),
        "bounds": [bound if np.isfinite(bound) else None for bound in interval],
        "margin": float(room[nearest]),
        "at": float(times[nearest]),
        "active": _stretches(room <= _ACTIVE * scale, times),
    }


def _stretches(active: NDArray[np.bool_], times: Vector) -> list[list[float]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], active.astype(np.int8), [0]])))
    return [[float(times[start]), float(times[stop - 1])] for start, stop in edges.reshape(-1, 2)]
