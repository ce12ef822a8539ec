"""Independent verification: fly the returned control on the original model, compare with what was promised.

Knows nothing of the method that it checks. Errors are relative to each quantity's scale, the largest
magnitude on the trajectory (at least 1e-6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.flight import INTEGRATOR, RTOL, ControlledModel, FlightError
from solvers.problem import Constraint, OptimalControlProblem
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

SMALLEST_SCALE = 1e-6
# Beyond this growth, rounding alone would move the end by more than a millionth of its scale.
MEANINGFUL_GROWTH = 1e8
_SAMPLES_PER_ARC = 8


@dataclass(frozen=True)
class Tolerances:
    """Limits of a verified result, relative to each quantity's scale."""

    terminal_error: float = 1e-2
    state_error: float = 1e-2
    bound: float = 1e-2
    path: float = 1e-2


@dataclass(frozen=True)
class Check:
    """One comparison; ``value`` is None where it could not be computed, which fails."""

    name: str
    value: float | None
    limit: float

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit."""
        return self.value is not None and self.value <= self.limit


@dataclass(frozen=True)
class StateReport:
    """Errors of one state in its own units, and the time of the largest one between breakpoints."""

    terminal_error: float | None
    max_error: float | None
    at: float | None
    tolerance: float


@dataclass(frozen=True)
class Verification:
    """What the flight showed. Scaled maxima, a report for each state, and the checks that decide."""

    terminal_error: float | None
    max_state_error: float | None
    max_bound_violation: float
    max_path_violation: float
    objective: float | None
    growth: float | None
    states: Mapping[str, StateReport]
    tolerances: Tolerances
    checks: tuple[Check, ...]
    note: str
    hamiltonian_drift: float | None = None

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    def to_dict(self) -> dict[str, Any]:
        """The ``verification`` of a result."""
        return {
            "integrator": INTEGRATOR,
            "rtol": RTOL,
            "terminal_error": self.terminal_error,
            "max_state_error": self.max_state_error,
            "max_bound_violation": self.max_bound_violation,
            "max_path_violation": self.max_path_violation,
            "objective": self.objective,
            "hamiltonian_drift": self.hamiltonian_drift,
            "mesh_error_estimate": None,
            "growth": self.growth,
            "states": {
                name: {
                    "terminal_error": report.terminal_error,
                    "max_error": report.max_error,
                    "at": report.at,
                    "tolerance": report.tolerance,
                }
                for name, report in self.states.items()
            },
            "tolerances": vars(self.tolerances),
            "checks": [
                {"name": check.name, "value": check.value, "limit": check.limit, "passed": check.passed}
                for check in self.checks
            ],
            "passed": self.passed,
            "note": self.note,
        }


def verify(
    problem: OptimalControlProblem, trajectory: Trajectory, tolerances: Tolerances, deadline: float
) -> Verification:
    """Integrate the returned control, clipped to its bounds, and compare.

    ``deadline`` (of ``time.monotonic()``) bounds the effort: what is not computed by then is None, and fails.
    """
    tau = dense(trajectory.breakpoints)
    states, controls = trajectory.states_at(tau), trajectory.controls_at(tau)
    state_scale = np.maximum(SMALLEST_SCALE, np.abs(states).max(axis=1))
    model = ControlledModel(problem, trajectory, state_scale, deadline)
    arc_errors = ends = objective = growth = None
    note, flown = "", False
    promised = trajectory.states_at(model.breakpoints)
    try:
        slopes, arcs = model.linearised(promised[:, :-1])
        arc_errors = np.abs(arcs.inside - _inside(trajectory, model.breakpoints))
        ends, objective = promised[:, -1], float(arcs.costs.sum())
        growth = model.growth(slopes)
        if growth <= MEANINGFUL_GROWTH:
            flight = model.fly(promised, slopes, arcs)
            ends, objective, flown = flight.states[:, -1], flight.cost, True
    except FlightError as error:
        note = f"The whole flight was not computed: {error}."
    meaningful = growth is None or growth <= MEANINGFUL_GROWTH
    if not meaningful:
        note = (
            f"Small errors grow {growth:.1e} times over the whole flight, so that its end says nothing; "
            "success rests on the error from breakpoint to breakpoint."
        )
    misses = _misses(problem, promised[:, -1], ends) if flown and ends is not None else None
    bound_violation = max(
        _violation(states, np.array(problem.state_bounds), state_scale),
        _violation(
            controls, model.bounds, np.maximum(SMALLEST_SCALE, np.abs(controls).max(axis=1, initial=0.0))
        ),
    )
    scope = problem.scope(states, model.clipped(tau), trajectory.time(tau), problem.parameters)
    path_violation = _largest_violation(problem.path, scope)
    end_scope = _ends_scope(
        problem, trajectory, model, promised[:, 0], promised[:, -1] if ends is None else ends
    )
    if objective is not None and problem.terminal_cost is not None:
        objective += float(problem.terminal_cost.evaluate(end_scope, NUMPY.functions))
    checks = [
        Check("state_error", _scaled_maximum(arc_errors, state_scale), tolerances.state_error),
        Check("bound", bound_violation, tolerances.bound),
        Check("path", path_violation, tolerances.path),
        Check(
            "ends",
            max(
                _start_violation(problem, promised[:, 0], state_scale),
                _largest_violation(problem.boundary, end_scope),
            ),
            tolerances.terminal_error,
        ),
    ]
    if meaningful:
        checks.insert(
            0, Check("terminal_error", _scaled_maximum(misses, state_scale), tolerances.terminal_error)
        )
    return Verification(
        terminal_error=_scaled_maximum(misses, state_scale),
        max_state_error=_scaled_maximum(arc_errors, state_scale),
        max_bound_violation=bound_violation,
        max_path_violation=path_violation,
        objective=objective,
        growth=growth,
        states={
            name: _state_report(
                index, arc_errors, misses, trajectory, model.breakpoints, state_scale, tolerances
            )
            for index, name in enumerate(problem.states)
        },
        tolerances=tolerances,
        checks=tuple(checks),
        note=note,
    )


def dense(breakpoints: Vector) -> Vector:
    """The breakpoints and equally spaced points between them."""
    fractions = np.arange(_SAMPLES_PER_ARC) / _SAMPLES_PER_ARC
    return np.append((breakpoints[:-1, None] + np.diff(breakpoints)[:, None] * fractions).ravel(), 1.0)


def violation(values: Vector, interval: tuple[float, float]) -> Vector:
    """How far each value lies outside the interval, in its own units; NaN counts as infinitely far."""
    outside = np.maximum(interval[0] - values, values - interval[1])
    return np.where(np.isnan(values), np.inf, np.maximum(outside, 0.0))


def _inside(trajectory: Trajectory, breakpoints: Vector) -> Vector:
    """The returned states where :class:`Arcs` has its inner points, (n, K, 4)."""
    fractions = np.array([0.25, 0.5, 0.75, 1.0])
    tau = breakpoints[:-1, None] + np.diff(breakpoints)[:, None] * fractions
    return trajectory.states_at(tau.ravel()).reshape(-1, *tau.shape)


def _misses(problem: OptimalControlProblem, promised: Vector, flown: Vector) -> Vector:
    """For each state, how far the flown end lies from the returned one and from the end condition."""
    off_target = [float(violation(flown[i], end)) for i, end in enumerate(problem.final_state)]
    return np.maximum(np.abs(flown - promised), off_target)


def _violation(values: Vector, bounds: Vector, scale: Vector) -> float:
    if values.size == 0:
        return 0.0
    outside = np.maximum(bounds[:, :1] - values, values - bounds[:, 1:])
    return float(max(0.0, np.max(outside / scale[:, None])))


def _largest_violation(constraints: Sequence[Constraint], scope: Mapping[str, Any]) -> float:
    largest = 0.0
    for constraint in constraints:
        with np.errstate(all="ignore"):
            values = np.atleast_1d(
                np.asarray(constraint.expression.evaluate(scope, NUMPY.functions), np.float64)
            )
        scale = max(SMALLEST_SCALE, float(np.max(np.abs(values))))
        largest = max(largest, float(np.max(violation(values, constraint.interval))) / scale)
    return largest


def _start_violation(problem: OptimalControlProblem, start: Vector, scale: Vector) -> float:
    outside = [float(violation(start[i], interval)) for i, interval in enumerate(problem.initial_state)]
    return float(np.max(np.array(outside) / scale))


def _ends_scope(
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    model: ControlledModel,
    start: Vector,
    stop: Vector,
) -> dict[str, Any]:
    controls = model.clipped(np.array([0.0, 1.0]))
    return problem.ends_scope(
        (start, controls[:, 0], trajectory.t0), (stop, controls[:, 1], trajectory.tf), problem.parameters
    )


def _scaled_maximum(errors: Vector | None, scale: Vector) -> float | None:
    if errors is None:
        return None
    return float(np.max(errors.reshape(scale.size, -1) / scale[:, None]))


def _state_report(
    index: int,
    arc_errors: Vector | None,
    misses: Vector | None,
    trajectory: Trajectory,
    breakpoints: Vector,
    scale: Vector,
    tolerances: Tolerances,
) -> StateReport:
    largest = at = None
    if arc_errors is not None:
        arc, point = np.unravel_index(int(np.argmax(arc_errors[index])), arc_errors[index].shape)
        largest = float(arc_errors[index, arc, point])
        fraction = (0.25, 0.5, 0.75, 1.0)[int(point)]
        tau = breakpoints[arc] + fraction * (breakpoints[arc + 1] - breakpoints[arc])
        at = float(trajectory.time(np.array([tau]))[0])
    terminal = None if misses is None else float(misses[index])
    return StateReport(terminal, largest, at, float(tolerances.state_error * scale[index]))
