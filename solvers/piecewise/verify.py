"""Verification of a mission: what was flown, integrated again by other means, and held against every box.

All pieces of the control are integrated side by side by SciPy over NumPy arrays, each from where the flight
was: neither the compiled step nor its choice of lengths is trusted.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from solvers.backends import NUMPY
from solvers.piecewise.equations import Equations
from solvers.piecewise.pieces import Pieces
from solvers.piecewise.plant import Plant
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.verify import (
    SMALLEST_SCALE,
    Check,
    StateReport,
    Tolerances,
    Verification,
    dense,
    largest_violation,
    scaled_violation,
)

Vector = NDArray[np.float64]

RTOL = 1e-11


class UnflownError(Exception):
    """The flight cannot be integrated again; the message says why."""


def verify_mission(
    plant: Plant,
    pieces: Pieces,
    trajectory: Trajectory,
    limits: Vector,
    tolerances: Tolerances,
    *,
    objective: float,
    stop: bool | None,
    deadline: float,
) -> Verification:
    """Integrate every piece again and hold the flight against bounds, limits (m, 2), constraints and ends.

    ``stop``: whether the document's stop was met, None if it has none. What is not computed by the
    ``deadline`` (of ``time.monotonic()``) is None, and fails.
    """
    problem = plant.problem
    tau = dense(trajectory.breakpoints)
    states, controls = trajectory.states_at(tau), trajectory.controls_at(tau)
    scale = np.maximum(SMALLEST_SCALE, np.abs(states).max(axis=1))
    errors: Vector | None = None
    note = ""
    try:
        errors = _errors(plant, pieces, deadline)
    except UnflownError as error:
        note = f"The flight was not integrated again: {error}."
    state_error = None if errors is None else float(np.max(errors / scale[:, None], initial=0.0))
    bound = max(
        scaled_violation(states, np.array(problem.state_bounds), scale),
        scaled_violation(
            controls, limits, np.maximum(SMALLEST_SCALE, np.abs(controls).max(axis=1, initial=0.0))
        ),
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
    return max(final, largest_violation(problem.boundary, ends_of(problem, trajectory)))


def ends_of(problem: OptimalControlProblem, trajectory: Trajectory) -> dict[str, Any]:
    """Both ends of a trajectory as expressions there know them."""
    edges = np.array([0.0, 1.0])
    states, controls = trajectory.states_at(edges), trajectory.controls_at(edges)
    first, last = zip(states.T, controls.T, (trajectory.t0, trajectory.tf), strict=True)
    return problem.ends_scope(first, last, problem.parameters, NUMPY)


def _errors(plant: Plant, pieces: Pieces, deadline: float) -> Vector:
    """By how much each piece ends elsewhere than it was flown, in the problem's states, (n, N)."""
    equations, count = plant.equations, pieces.times.size - 1
    order = [plant.problem.controls.index(name) for name in equations.controls]
    start, span = pieces.times[:-1], np.diff(pieces.times)
    before, after = pieces.before[:, order].T, pieces.after[:, order].T
    held = dict(zip(equations.held_names, pieces.held.T, strict=True))
    first = pieces.states[:-1].T
    size = np.maximum(np.abs(pieces.states).max(axis=0), SMALLEST_SCALE)[:, None]

    def rate(part: float, y: Vector) -> Vector:
        if time.monotonic() > deadline:
            raise UnflownError("the time for it was over")
        x = y.reshape(-1, count) * size
        u = before + part * (after - before)
        return np.asarray(_rates(equations, x, u, start + part * span, held) * span / size).ravel()

    start_values = np.asarray(first / size, np.float64).ravel()
    flown = solve_ivp(rate, (0.0, 1.0), start_values, method="DOP853", rtol=RTOL, atol=RTOL)
    if not flown.success:
        raise UnflownError(flown.message)
    ends = flown.y[:, -1].reshape(-1, count) * size
    again, then = (
        np.asarray(plant.sight.map(count)(values, pieces.times[None, 1:]).full(), np.float64)
        for values in (ends, pieces.states[1:].T)
    )
    off = np.abs(again - then)
    for index, name in enumerate(plant.problem.states):
        if name in plant.view.periods:
            period = plant.view.periods[name]
            off[index] = np.abs((off[index] + period / 2) % period - period / 2)
    return np.asarray(off, np.float64)


def _rates(equations: Equations, x: Vector, u: Vector, t: Vector, held: Mapping[str, Any]) -> Vector:
    with np.errstate(all="ignore"):
        rates = equations.rate(list(x), list(u), t, NUMPY, held)
    return np.array([np.broadcast_to(rate, t.shape) for rate in rates], np.float64)


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
