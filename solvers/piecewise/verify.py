"""Verification of a mission: what was flown, integrated again by other means, and held against every box.

All pieces of the control are integrated side by side by SciPy over NumPy arrays, each from where the flight
was: neither the compiled step nor its choice of lengths is trusted.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from solvers.backends import NUMPY
from solvers.piecewise.pieces import Pieces
from solvers.piecewise.plan import actuator_limits
from solvers.piecewise.plant import Plant
from solvers.problem import OptimalControlProblem
from solvers.spec import PiecewiseMethod
from solvers.trajectory import Trajectory
from solvers.verification.boundary import End, boundary_violation
from solvers.verification.verdict import Check, StateReport, Tolerances, Verification
from solvers.verification.violations import (
    SMALLEST_SCALE,
    dense,
    largest_violation,
    scale_of,
    scaled_violation,
)

Vector = NDArray[np.float64]

RTOL = 1e-11


class UnflownError(Exception):
    """The flight cannot be integrated again; the message says why."""


def verify_mission(
    plant: Plant,
    method: PiecewiseMethod,
    pieces: Pieces,
    trajectory: Trajectory,
    tolerances: Tolerances,
    *,
    stop: bool | None,
    deadline: float,
) -> Verification:
    """Integrate every piece again and hold the flight against bounds, limits, constraints and ends.

    ``pieces`` end with the trajectory, or with the last one that is over by then. ``stop``: whether the
    document's stop was met, None if it has none. What is not computed by the ``deadline`` (of
    ``time.monotonic()``) is None, and fails.
    """
    problem = plant.problem
    tau = dense(trajectory.breakpoints)
    states, controls = trajectory.states_at(tau), trajectory.controls_at(tau)
    scale = np.maximum(SMALLEST_SCALE, np.abs(states).max(axis=1))
    errors, objective, note = None, None, ""
    try:
        errors, cost = _fly_again(plant, pieces, deadline)
        objective = (
            cost + _rest_of_cost(problem, trajectory, pieces.times[-1]) + terminal_cost(problem, trajectory)
        )
    except UnflownError as error:
        note = f"The flight was not integrated again: {error}."
    state_error = None if errors is None else float(np.max(errors / scale[:, None], initial=0.0))
    largest = np.maximum(SMALLEST_SCALE, np.abs(controls).max(axis=1, initial=0.0))
    bound = max(
        scaled_violation(states, np.array(problem.state_bounds), scale),
        scaled_violation(controls, actuator_limits(problem, method), largest),
    )
    scope = problem.scope(states, controls, trajectory.time(tau), problem.parameters, NUMPY)
    path = largest_violation(problem.path, scope, tau)
    checks = [
        Check("state_error", state_error, tolerances.state_error),
        Check("bound", bound, tolerances.bound),
        Check("path", path, tolerances.path),
    ]
    if stop is None:
        ends = _missed_end(plant, trajectory, scale)
        checks.append(Check("ends", ends, tolerances.terminal_error))
    else:
        ends = None
        checks.append(Check("stop", 0.0 if stop else None, 0.0))
    return Verification(
        terminal_error=ends,
        max_state_error=state_error,
        max_bound_violation=bound,
        max_path_violation=path,
        objective=objective,
        integrals={},
        growth=None,
        states=_reports(problem.states, errors, pieces.times, tolerances.state_error * scale),
        tolerances=tolerances,
        checks=tuple(checks),
        note=note,
    )


def _missed_end(plant: Plant, trajectory: Trajectory, scale: Vector) -> float:
    problem = plant.problem
    end = trajectory.states_at(np.array([1.0]))
    final = scaled_violation(end, np.array(problem.final_state), scale)
    sizes = scale, scale_of(trajectory.controls_at(dense(trajectory.breakpoints)))

    def scope(initial: Any, last: Any, integrals: Any) -> dict[str, Any]:
        return problem.ends_scope(initial, last, problem.parameters, NUMPY, integrals)

    none = np.zeros(len(problem.integrals))
    return max(final, boundary_violation(problem.boundary, _ends(trajectory), (sizes, sizes), none, scope))


def _ends(trajectory: Trajectory) -> tuple[End, End]:
    """States, controls and time at both ends."""
    edges = np.array([0.0, 1.0])
    states, controls = trajectory.states_at(edges), trajectory.controls_at(edges)
    first, last = zip(states.T, controls.T, (trajectory.t0, trajectory.tf), strict=True)
    return first, last


def terminal_cost(problem: OptimalControlProblem, trajectory: Trajectory) -> float:
    """The terminal cost of a trajectory."""
    if problem.terminal_cost is None:
        return 0.0
    with np.errstate(all="ignore"):
        scope = problem.ends_scope(*_ends(trajectory), problem.parameters, NUMPY)
        return float(problem.terminal_cost.evaluate(scope, NUMPY.functions))


def _rest_of_cost(problem: OptimalControlProblem, trajectory: Trajectory, start: float) -> float:
    """The running cost from ``start`` to the end of the trajectory, by Simpson's rule: part of a piece."""
    tau = np.linspace(float(trajectory.tau(np.array([start]))[0]), 1.0, 3)
    tau[0] = np.nextafter(tau[0], 2.0)  # where the control jumps, its right side
    costs = _running_cost(
        problem, list(trajectory.states_at(tau)), list(trajectory.controls_at(tau)), trajectory.time(tau)
    )
    return float((trajectory.tf - start) / 6.0 * (costs[0] + 4.0 * costs[1] + costs[2]))


def _running_cost(problem: OptimalControlProblem, x: Sequence[Any], u: Sequence[Any], t: Vector) -> Vector:
    if problem.running_cost is None:
        return np.zeros_like(t)
    scope = problem.scope(x, u, t, problem.parameters, NUMPY)
    with np.errstate(all="ignore"):
        value = problem.running_cost.evaluate(scope, NUMPY.functions)
    return np.asarray(np.broadcast_to(value, t.shape), np.float64)


def _fly_again(plant: Plant, pieces: Pieces, deadline: float) -> tuple[Vector, float]:
    """How far from where it was each piece ends, in the problem's states (n, N), and the running cost."""
    equations, count = plant.equations, pieces.times.size - 1
    start, span = pieces.times[:-1], np.diff(pieces.times)
    before, after = pieces.before.T, pieces.after.T
    held = dict(zip(equations.held_names, pieces.held.T, strict=True))
    first = np.vstack([pieces.states[:-1].T, np.zeros(count)])
    size = np.append(np.maximum(np.abs(pieces.states).max(axis=0), SMALLEST_SCALE), 1.0)[:, None]

    def rate(part: float, y: Vector) -> Vector:
        if time.monotonic() > deadline:
            raise UnflownError("the time for it was over")
        x = list(y.reshape(-1, count)[:-1] * size[:-1])
        u, t = before + part * (after - before), start + part * span
        with np.errstate(all="ignore"):
            rates = equations.rate(x, plant.ordered(list(u)), t, NUMPY, held)
            cost = _running_cost(plant.problem, plant.observe(x, t, NUMPY), list(u), t)
        rows = [np.broadcast_to(row, t.shape) for row in (*rates, cost)]
        return np.asarray(np.array(rows, np.float64) * span / size).ravel()

    values = np.asarray(first / size, np.float64).ravel()
    flown = solve_ivp(rate, (0.0, 1.0), values, method="DOP853", rtol=RTOL, atol=RTOL)
    if not flown.success:
        raise UnflownError(flown.message)
    ends = flown.y[:, -1].reshape(-1, count) * size
    with np.errstate(all="ignore"):
        again, then = (
            np.array(plant.observe(list(states), pieces.times[1:], NUMPY), np.float64)
            for states in (ends[:-1], pieces.states[1:].T)
        )
    off = np.abs(again - then)
    for index, name in enumerate(plant.problem.states):
        if name in plant.view.periods:
            period = plant.view.periods[name]
            off[index] = np.abs((off[index] + period / 2) % period - period / 2)
    return np.asarray(off, np.float64), float(ends[-1].sum())


def _reports(
    names: Sequence[str], errors: Vector | None, times: Vector, tolerances: Vector
) -> dict[str, StateReport]:
    reports = {}
    for index, name in enumerate(names):
        largest = at = None
        if errors is not None:
            piece = int(np.argmax(errors[index]))
            largest, at = float(errors[index, piece]), float(times[piece + 1])
        reports[name] = StateReport(None, largest, at, float(tolerances[index]))
    return reports
