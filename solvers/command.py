"""The table that an on-board computer plays: values held for one period each, and what they do to the model.

Row k holds on [t_k, t_k + period) with t_k = t0 + k period, shifted by the delay; no control is given before
the first row and after the last one. ``average`` gives the mean of the control over the period (nothing after
tf, so that the impulse is that of the flight), ``sample`` its value at t_k.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from solvers.bases.legendre import legendre_gauss
from solvers.coast import coast, flown_end
from solvers.curves import StepCurve
from solvers.flight import INTEGRATOR, RTOL, FlightError
from solvers.problem import OptimalControlProblem
from solvers.spec import CommandSpec
from solvers.trajectory import Trajectory
from solvers.violations import SMALLEST_SCALE

Vector = NDArray[np.float64]

MAX_ROWS = 20_001
_GAUSS_POINTS = 12


@dataclass(frozen=True)
class Command:
    """Rows at the times ``t`` (K,), each held for ``period``; ``controls``: name -> (K,) values."""

    t: Vector
    period: float
    rule: Literal["average", "sample"]
    delay: float
    controls: Mapping[str, Vector]

    def to_dict(self) -> dict[str, Any]:
        """The ``command`` of a result without its verification."""
        return {
            "t": self.t.tolist(),
            "period": self.period,
            "rule": self.rule,
            "delay": self.delay,
            "controls": {name: values.tolist() for name, values in self.controls.items()},
        }


def rows(spec: CommandSpec, duration: float) -> int:
    """The number of rows for a flight; a last one that would begin at tf but for rounding is none."""
    return max(1, math.ceil(duration / spec.period * (1.0 - 1e-12)))


def make_command(spec: CommandSpec, problem: OptimalControlProblem, answer: Trajectory) -> Command:
    """The table of an answer; ``problem`` has the controls of the document, not their rates."""
    count = rows(spec, answer.duration)
    start = answer.t0 + spec.period * np.arange(count, dtype=np.float64)
    curves = {**answer.states, **answer.controls}
    controls = {}
    for name, bounds in zip(problem.controls, problem.control_bounds, strict=True):
        if spec.rule == "sample":
            values = curves[name](answer.one_sided(start))
        else:
            values = _means(answer, name, np.append(start, start[-1] + spec.period))
        values = np.clip(values, *bounds)
        quantum = spec.quantum.get(name)
        if quantum:
            values = _quantised(values, quantum, bounds)
        controls[name] = values
    return Command(start, spec.period, spec.rule, spec.delay, controls)


def _means(answer: Trajectory, name: str, edges: Vector) -> Vector:
    """Means of a control between edges (K + 1), 0 beyond the flight: exact up to degree 23 between breaks."""
    curve = {**answer.states, **answer.controls}[name]
    inner = np.clip((edges - answer.t0) / answer.duration, 0.0, 1.0)
    breaks = np.union1d(answer.breakpoints, inner)
    widths = np.diff(breaks)
    points, weights = legendre_gauss(_GAUSS_POINTS)
    tau = breaks[:-1, None] + widths[:, None] * (points + 1.0) / 2.0
    pieces = widths * (curve(tau.ravel()).reshape(tau.shape) @ weights) / 2.0
    totals = np.concatenate([[0.0], np.cumsum(pieces)])
    sums = np.diff(totals[np.searchsorted(breaks, inner)])
    return np.asarray(sums * answer.duration / np.diff(edges), np.float64)


def _quantised(values: Vector, quantum: float, bounds: tuple[float, float]) -> Vector:
    """The nearest multiples of a quantum within the bounds."""
    lowest = math.ceil(bounds[0] / quantum - 1e-9) if np.isfinite(bounds[0]) else -np.inf
    highest = math.floor(bounds[1] / quantum + 1e-9) if np.isfinite(bounds[1]) else np.inf
    return np.asarray(quantum * np.clip(np.round(values / quantum), lowest, highest), np.float64)


def played(command: Command, problem: OptimalControlProblem, answer: Trajectory) -> Trajectory:
    """The answer with the rows of the table as its controls, until the last one has been held.

    Its states are still those that were promised, stretched over the longer time.
    """
    end = command.t[-1] + command.period + command.delay
    edges = np.unique([answer.t0, *(command.t + command.delay), end])
    breaks = (edges - answer.t0) / (end - answer.t0)
    zeros = np.zeros(int(edges.size - 1 - command.t.size))
    steps = {
        name: StepCurve(breaks, np.concatenate([zeros, values])) for name, values in command.controls.items()
    }
    states = {name: answer.states[name] for name in problem.states}
    return Trajectory(
        answer.t0, float(end), states, steps, "previous", {}, breaks, breaks, design=answer.design
    )


def fly_command(
    command: Command, problem: OptimalControlProblem, answer: Trajectory, seconds: float | None = None
) -> dict[str, Any]:
    """Integrate the model under the table from the start of the answer; what the end is, and misses.

    Then, where ``seconds`` are given, on without control.
    ``terminal_error`` is the largest distance from an end condition, relative to the magnitude of its state
    on the trajectory; None where the flight does not come to its end.
    """
    flown = played(command, problem, answer)
    tau = answer.tau(flown.time(flown.breakpoints))
    promised = np.array([answer.states[name](tau) for name in problem.states])
    scale = np.maximum(SMALLEST_SCALE, np.abs(promised).max(axis=1))
    report: dict[str, Any] = {"integrator": INTEGRATOR, "rtol": RTOL, "final_time": flown.tf}
    try:
        final = flown_end(problem, flown, promised)
    except FlightError as error:
        note = f"It was not flown to its end: {error}."
        return {**report, "terminal_error": None, "states": {}, "note": note}
    bounds = np.array(problem.final_state)
    miss = np.maximum(np.maximum(bounds[:, 0] - final, final - bounds[:, 1]), 0.0)
    found = {
        **report,
        "terminal_error": float(np.max(miss / scale)),
        "states": {
            name: {"final": float(value), "error": float(error) if np.isfinite(bound).any() else None}
            for name, value, error, bound in zip(problem.states, final, miss, bounds, strict=True)
        },
        "note": "",
    }
    if seconds is not None:
        found["coast"] = coast(problem, flown, final, seconds)
    return found
