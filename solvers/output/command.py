"""The table that an on-board computer plays: values held for one period each, and what they do to the model.

Row k holds on [t_k, t_k + period) with t_k = t0 + k period, shifted by the delay; no control is given before
the first row and after the last one. ``average`` gives the mean of the control over the period (nothing after
tf, so that the impulse is that of the flight), ``sample`` its value at t_k.

One table goes over all phases: periods do not stop where phases meet. Where a phase does not have a control
it counts as zero, for a computer plays numbers, and nothing listens. A row is within the bounds of all phases
in which it is held; where these have no value in common, between the bounds of one and of the other.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from solvers.bases.legendre import composite_gauss
from solvers.curves import Curve, StepCurve
from solvers.formulation.quantities import FREE
from solvers.output.coast import coast
from solvers.phases.trajectory import PhasedTrajectory
from solvers.spec import CommandSpec
from solvers.trajectory import Trajectory
from solvers.verification.flight import INTEGRATOR, RTOL, FlightError
from solvers.verification.legs import Leg, fly_legs
from solvers.verification.violations import SMALLEST_SCALE

Vector = NDArray[np.float64]

MAX_ROWS = 20_001
_GAUSS_POINTS = 12
# Instants that are closer than this part of the flight are the same.
_ROUNDING = 1e-12
# How a lower and an upper bound are made narrower.
_NARROWER = np.maximum, np.minimum


@dataclass(frozen=True)
class Command:
    """Rows at the times ``t`` (K,), each held for ``period``; ``controls``: name -> (K,) values."""

    t: Vector
    period: float
    rule: Literal["average", "sample"]
    delay: float
    controls: Mapping[str, Vector]

    @property
    def end(self) -> float:
        """When the last row has been held."""
        return float(self.t[-1] + self.period + self.delay)

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


def make_command(spec: CommandSpec, legs: Sequence[Leg]) -> Command:
    """The table of an answer, whose ``legs`` have the controls of the document, not their rates."""
    whole = PhasedTrajectory(tuple(leg.answer for leg in legs), tuple(leg.name for leg in legs))
    start = whole.t0 + spec.period * np.arange(rows(spec, whole.tf - whole.t0), dtype=np.float64)
    edges, owners = np.append(start, start[-1] + spec.period), whole.owners(start)
    controls = {}
    for name in dict.fromkeys(name for leg in legs for name in leg.problem.controls):
        having = [leg for leg in legs if name in leg.problem.controls]
        if spec.rule == "sample":
            values = np.zeros(start.size)
            for index, leg in enumerate(legs):
                own = owners == index
                if name in leg.problem.controls:
                    values[own] = _curve(leg.answer, name)(leg.answer.one_sided(start[own]))
        else:
            values = np.sum([_integrals(leg.answer, name, edges) for leg in having], axis=0) / np.diff(edges)
        bounds = _bounds(name, having, edges, _ROUNDING * (whole.tf - whole.t0))
        values = np.clip(values, *bounds)
        quantum = spec.quantum.get(name)
        if quantum:
            values = _quantised(values, quantum, bounds)
        controls[name] = values
    return Command(start, spec.period, spec.rule, spec.delay, controls)


def _curve(answer: Trajectory, name: str) -> Curve:
    """A control of the document, which is a state of the answer where its rate was chosen."""
    return answer.controls[name] if name in answer.controls else answer.states[name]


def _integrals(answer: Trajectory, name: str, edges: Vector) -> Vector:
    """Integrals of a control between edges (K + 1), 0 beyond: exact up to degree 23 between breaks."""
    curve = _curve(answer, name)
    inner = np.clip((edges - answer.t0) / answer.duration, 0.0, 1.0)
    breaks = np.union1d(answer.breakpoints, inner)
    tau, weights = composite_gauss(breaks, _GAUSS_POINTS)
    pieces = (weights * curve(tau)).reshape(-1, _GAUSS_POINTS).sum(axis=1)
    totals = np.concatenate([[0.0], np.cumsum(pieces)])
    sums = np.diff(totals[np.searchsorted(breaks, inner)])
    return np.asarray(sums * answer.duration, np.float64)


def _bounds(name: str, legs: Sequence[Leg], edges: Vector, rounding: float) -> tuple[Vector, Vector]:
    """The bounds of each row (K,): what the legs that it touches have in common, else all between them."""
    tightest = np.full((2, edges.size - 1), [[-np.inf], [np.inf]])
    widest = -tightest
    for leg in legs:
        bounds = leg.problem.control_bounds[leg.problem.controls.index(name)]
        held = np.minimum(edges[1:], leg.answer.tf) - np.maximum(edges[:-1], leg.answer.t0) > rounding
        for row, bound, narrower, wider in zip((0, 1), bounds, _NARROWER, _NARROWER[::-1], strict=True):
            tightest[row, held] = narrower(tightest[row, held], bound)
            widest[row, held] = wider(widest[row, held], bound)
    lower, upper = np.where(tightest[0] <= tightest[1], tightest, widest)
    return lower, upper


def _quantised(values: Vector, quantum: float, bounds: tuple[Vector, Vector]) -> Vector:
    """The nearest multiples of a quantum within the bounds."""
    lowest, highest = np.ceil(bounds[0] / quantum - 1e-9), np.floor(bounds[1] / quantum + 1e-9)
    return np.asarray(quantum * np.clip(np.round(values / quantum), lowest, highest), np.float64)


def played(command: Command, controls: Collection[str], start: float, stop: float) -> Trajectory:
    """The rows of these controls between two times, zero before the first one; without states."""
    edges = np.unique([command.t[0], *(command.t + command.delay), command.end])
    first = np.zeros(edges.size - 1 - command.t.size)
    margin = _ROUNDING * (stop - start)
    inner = edges[(edges > start + margin) & (edges < stop - margin)]
    times = np.concatenate([[start], inner, [stop]])
    breaks = (times - start) / (stop - start)
    row = np.searchsorted(edges, times[:-1] + margin, side="right") - 1
    steps = {
        name: StepCurve(breaks, np.concatenate([first, command.controls[name]])[row]) for name in controls
    }
    return Trajectory(start, stop, {}, steps, "previous", {}, breaks, breaks)


def fly_command(command: Command, legs: Sequence[Leg], seconds: float | None = None) -> dict[str, Any]:
    """Integrate the models under the table from the start of the answer; what the ends are, and misses.

    The last leg is flown until the last row has been held; then, where ``seconds`` are given, on without
    control. ``terminal_error`` is the largest distance from an end condition, relative to the magnitude of
    its state on the trajectory; None where the flight does not come to its end. With several legs each of
    them is told of under ``phases``.
    """
    # As the table has it, which nothing clips.
    legs = [
        replace(leg, problem=replace(leg.problem, control_bounds=(FREE,) * len(leg.problem.controls)))
        for leg in legs
    ]
    stops = [*(leg.answer.tf for leg in legs[:-1]), command.end]
    flown = [
        replace(played(command, leg.problem.controls, leg.answer.t0, stop), design=leg.answer.design)
        for leg, stop in zip(legs, stops, strict=True)
    ]
    promised = [_promised(leg, own) for leg, own in zip(legs, flown, strict=True)]
    report: dict[str, Any] = {"integrator": INTEGRATOR, "rtol": RTOL, "final_time": command.end}
    ends: list[Vector] = []
    try:
        ends.extend(fly_legs(legs, flown, promised))
    except FlightError as error:
        note = f"It was not flown to its end: {error}."
        return {**report, "terminal_error": None, "states": {}, "note": note}
    parts = [_end_of(leg, *both) for leg, *both in zip(legs, promised, ends, strict=True)]
    found = {
        **report,
        "terminal_error": max(part["terminal_error"] for part in parts),
        "states": {name: state for part in parts for name, state in part["states"].items()},
        "note": "",
    }
    if len(parts) > 1:
        found["phases"] = [
            {"name": leg.name, "final_time": own.tf, **part}
            for leg, own, part in zip(legs, flown, parts, strict=True)
        ]
    if seconds is not None:
        found["coast"] = coast(legs[-1].problem, flown[-1], ends[-1], seconds)
    return found


def _promised(leg: Leg, flown: Trajectory) -> Vector:
    """The states (n, K + 1) of the answer at the breakpoints of a control that may last longer."""
    tau = leg.answer.tau(flown.time(flown.breakpoints))
    return np.array([leg.answer.states[name](tau) for name in leg.problem.states])


def _end_of(leg: Leg, promised: Vector, final: Vector) -> dict[str, Any]:
    """Where a leg ends, and by how much it misses where it should."""
    scale = np.maximum(SMALLEST_SCALE, np.abs(promised).max(axis=1))
    bounds = np.array(leg.problem.final_state)
    miss = np.maximum(np.maximum(bounds[:, 0] - final, final - bounds[:, 1]), 0.0)
    return {
        "terminal_error": float(np.max(miss / scale)),
        "states": {
            name: {"final": float(value), "error": float(error) if np.isfinite(bound).any() else None}
            for name, value, error, bound in zip(leg.problem.states, final, miss, bounds, strict=True)
        },
    }
