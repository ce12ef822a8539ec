"""The plant in flight: its equations and the view of them, compiled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.piecewise.flow import Flow
from solvers.piecewise.pieces import Pieces
from solvers.piecewise.plant import Plant
from solvers.symbolic import CASADI

Vector = NDArray[np.float64]

RTOL = 1e-10
"""Tolerance of a step of the flight, relative to the size of each state."""


@dataclass(frozen=True)
class CompiledPlant:
    """A plant as CasADi functions."""

    plant: Plant

    @cached_property
    def rate(self) -> ca.Function:
        """(states and cost, controls, time, held) -> their rates; the cost is the problem's running cost."""
        equations = self.plant.equations
        x = ca.SX.sym("x", len(equations.states) + 1)
        u = ca.SX.sym("u", len(self.plant.problem.controls))
        t, held = ca.SX.sym("t"), ca.SX.sym("held", len(equations.held_names))
        states = ca.vertsplit(x)[:-1]
        controls = self.plant.ordered(ca.vertsplit(u))
        kept = dict(zip(equations.held_names, ca.vertsplit(held), strict=True))
        rates = equations.rate(states, controls, t, CASADI, kept)
        cost: Any = 0.0
        if self.plant.problem.running_cost is not None:
            seen = self.plant.observe(states, t, CASADI)
            scope = self.plant.problem.scope(seen, ca.vertsplit(u), t, self.plant.problem.parameters, CASADI)
            cost = self.plant.problem.running_cost.evaluate(scope, CASADI.functions)
        rate = ca.vertcat(*[ca.SX(value) for value in (*rates, cost)])
        return ca.Function("plant", [x, u, t, held], [rate], {"cse": True})

    @cached_property
    def sight(self) -> ca.Function:
        """(plant's states, time) -> the problem's states, before angles are unwound."""
        x, t = ca.SX.sym("x", len(self.plant.equations.states)), ca.SX.sym("t")
        seen = self.plant.observe(ca.vertsplit(x), t, CASADI)
        return ca.Function("sight", [x, t], [ca.vertcat(*[ca.SX(value) for value in seen])], {"cse": True})

    @cached_property
    def _sight_rate(self) -> ca.Function:
        """(states, controls, time, held) -> the problem's states and their rates."""
        inputs = [ca.SX.sym(self.rate.name_in(i), self.rate.size1_in(i)) for i in range(4)]
        states, time = inputs[0][:-1], inputs[2]
        rate = self.rate(*inputs)[:-1]
        seen = self.sight(states, time)
        rates = ca.jtimes(seen, states, rate) + ca.jacobian(seen, time)
        return ca.Function("sight_rate", inputs, [rates], {"cse": True})

    def seen_rates(self, pieces: Pieces) -> Vector:
        """Rates of the problem's states at the N + 1 ends of pieces, (n, N + 1).

        Where the control jumps, the mean of both sides.
        """
        rate = self._sight_rate.map(pieces.times.size - 1)
        nothing = np.zeros((1, pieces.times.size - 1))
        sides = [
            rate(np.vstack([states.T, nothing]), controls.T, times[None, :], pieces.held.T).full()
            for states, controls, times in (
                (pieces.states[:-1], pieces.before, pieces.times[:-1]),
                (pieces.states[1:], pieces.after, pieces.times[1:]),
            )
        ]
        first, last = (np.asarray(side, np.float64) for side in sides)
        return np.hstack([first[:, :1], (first[:, 1:] + last[:, :-1]) / 2.0, last[:, -1:]])


class PlantFlight:
    """A plant in flight; the last of its states is the running cost so far."""

    def __init__(self, compiled: CompiledPlant) -> None:
        plant = compiled.plant
        self._plant = plant
        self._flow = Flow(compiled.rate, RTOL, watched=len(plant.equations.states))
        self._sight = compiled.sight
        self._periods = [
            (index, plant.view.periods[name])
            for index, name in enumerate(plant.problem.states)
            if name in plant.view.periods
        ]
        self._last: Vector | None = None
        self.held: list[Vector] = []
        """What was held over each piece that was flown."""

    def see(self, x: Vector, t: float) -> Vector:
        """The problem's states; angles go on from where they were seen last."""
        seen = self._sight(x[:-1], t).full().ravel()
        if self._last is not None:
            for index, period in self._periods:
                seen[index] += period * np.round((self._last[index] - seen[index]) / period)
        self._last = seen
        return np.asarray(seen, np.float64)

    def fly(self, x: Vector, t0: float, t1: float, u0: Vector, u1: Vector) -> Vector:
        """The states at t1 from ``x`` at t0. Raises RunawayError."""
        held = self._held(x, t0)
        self.held.append(held)
        return self._flow.fly(x, t0, t1, u0, u1, held)

    def _held(self, x: Vector, t: float) -> Vector:
        equations = self._plant.equations
        if not equations.held:
            return np.zeros(0)
        values = {**equations.parameters, **dict(zip(equations.states, x[:-1].tolist(), strict=True)), "t": t}
        return np.concatenate([item.function(values, NUMPY.functions) for item in equations.held])
