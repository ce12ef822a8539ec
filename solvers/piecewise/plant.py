"""The plant: what is really flown, seen as the simple model sees it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.expressions import parse
from solvers.models import LIBRARY, View
from solvers.piecewise.equations import Equations
from solvers.piecewise.flow import Flow
from solvers.piecewise.pieces import Pieces
from solvers.problem import OptimalControlProblem
from solvers.spec import LibraryReference, ProblemSpec, Value
from solvers.spec import Plant as PlantSpec
from solvers.symbolic import CASADI

Vector = NDArray[np.float64]

RTOL = 1e-10
"""Tolerance of a step of the plant's flight, relative to the size of each state."""


@dataclass(frozen=True)
class Plant:
    """The equations that are flown, and the view of them as states of the problem."""

    problem: OptimalControlProblem
    equations: Equations
    view: View

    @classmethod
    def of(cls, spec: ProblemSpec, plant: PlantSpec | None, problem: OptimalControlProblem) -> Plant:
        """The plant of a document; without one the problem's own model."""
        model = spec.submitted_model if plant is None else plant.model
        equations = Equations.of(model)
        if plant is None:
            return cls(problem, equations, _same(problem.states, equations.states))
        view = _same(problem.states, equations.states)
        simple = spec.submitted_model
        if isinstance(model, LibraryReference) and isinstance(simple, LibraryReference):
            view = LIBRARY[model.name].views.get(simple.name, view)
        return cls(problem, equations, _spoken(plant.observe, plant.start, view))

    def begin(self, simple: Vector, t: float) -> Vector:
        """The plant's states for those of the simple model at a time."""
        values = {**dict(zip(self.problem.states, simple.tolist(), strict=True)), "t": t}
        started = self.view.start(
            {**self.problem.parameters, **self.equations.parameters, **values}, NUMPY.functions
        )
        return np.array([float(started[name]) for name in self.equations.states])

    @cached_property
    def compiled(self) -> ca.Function:
        """(states and cost, controls, time, held) -> their rates; the cost is the problem's running cost."""
        equations = self.equations
        x = ca.SX.sym("x", len(equations.states) + 1)
        u = ca.SX.sym("u", len(self.problem.controls))
        t, held = ca.SX.sym("t"), ca.SX.sym("held", len(equations.held_names))
        states = ca.vertsplit(x)[:-1]
        controls = self._ordered(ca.vertsplit(u))
        kept = dict(zip(equations.held_names, ca.vertsplit(held), strict=True))
        rates = equations.rate(states, controls, t, CASADI, kept)
        cost: Any = 0.0
        if self.problem.running_cost is not None:
            seen = self._seen(states, t)
            scope = self.problem.scope(seen, ca.vertsplit(u), t, self.problem.parameters, CASADI)
            cost = self.problem.running_cost.evaluate(scope, CASADI.functions)
        rate = ca.vertcat(*[ca.SX(value) for value in (*rates, cost)])
        return ca.Function("plant", [x, u, t, held], [rate], {"cse": True})

    @cached_property
    def sight(self) -> ca.Function:
        """(plant's states, time) -> the problem's states, before angles are unwound."""
        x, t = ca.SX.sym("x", len(self.equations.states)), ca.SX.sym("t")
        seen = self._seen(ca.vertsplit(x), t)
        return ca.Function("sight", [x, t], [ca.vertcat(*[ca.SX(value) for value in seen])], {"cse": True})

    @cached_property
    def _sight_rate(self) -> ca.Function:
        """(states, controls, time, held) -> the problem's states and their rates."""
        inputs = [ca.SX.sym(self.compiled.name_in(i), self.compiled.size1_in(i)) for i in range(4)]
        states, time = inputs[0][:-1], inputs[2]
        rate = self.compiled(*inputs)[:-1]
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

    def _seen(self, states: list[ca.SX], t: ca.SX) -> list[Any]:
        values = {**dict(zip(self.equations.states, states, strict=True)), "t": t}
        seen = self.view.observe({**self.equations.parameters, **values}, CASADI.functions)
        return [seen[name] for name in self.problem.states]

    def _ordered(self, controls: Any) -> list[Any]:
        """The problem's controls in the order of the plant's."""
        by_name = dict(zip(self.problem.controls, controls, strict=True))
        return [by_name[name] for name in self.equations.controls]


class PlantFlight:
    """A plant in flight; the last of its states is the running cost so far."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._flow = Flow(plant.compiled, RTOL, watched=len(plant.equations.states))
        self._sight = plant.sight
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


def _same(simple: tuple[str, ...], plant: tuple[str, ...]) -> View:
    """The view of a plant whose states have the names of the simple model's."""
    return View(
        lambda values, _: {name: values[name] for name in simple if name in values},
        lambda values, _: {name: values[name] for name in plant if name in values},
        {},
    )


def _spoken(observe: Mapping[str, Value], start: Mapping[str, Value], otherwise: View) -> View:
    """The expressions of a document, and another view for what they leave out."""

    def spoken(
        table: Mapping[str, Value], rest: Callable[..., dict[str, Any]]
    ) -> Callable[..., dict[str, Any]]:
        def see(values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> dict[str, Any]:
            given = {name: parse(text).evaluate(values, functions) for name, text in table.items()}
            return rest(values, functions) | given

        return see

    periods = {name: period for name, period in otherwise.periods.items() if name not in observe}
    return View(spoken(observe, otherwise.observe), spoken(start, otherwise.start), periods)
