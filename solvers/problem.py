"""An optimal-control problem as numbers and callables, whatever they are evaluated over.

Minimise  phi(x(t0), u(t0), x(tf), u(tf), t0, tf) + integral of L(x, u, t) dt  subject to  x' = f(x, u, t),
bounds on states, controls, times and ends, path constraints h(x, u, t) and boundary constraints. A model of
second order also gives its residual  M(q) q'' + C(q, q') q' + K q - G u - f(q, q', t).

Every callable takes lists of values (floats, NumPy arrays of one shape, CasADi symbols), the parameters by
name, and the backend to which the values belong.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY, Backend
from solvers.expressions import Expression, parse
from solvers.guess import Guess, make_guess
from solvers.spec import (
    FirstOrderModel,
    MechanicalModel,
    ProblemSpec,
    bound_interval,
    final_intervals,
    initial_intervals,
)
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]
Values = Sequence[Any] | Vector
"""One value a state, coordinate or control; rows of an array where these are arrays."""
Parameters = Mapping[str, Any]
Interval = tuple[float, float]
FREE: Interval = (-np.inf, np.inf)


@dataclass(frozen=True)
class Constraint:
    """An expression held within ``interval``; ``pointer`` is its place in the document."""

    name: str
    pointer: str
    expression: Expression
    interval: Interval


@dataclass(frozen=True)
class FirstOrderDynamics:
    """x_i' = f_i(x, u, t), one expression a state."""

    model: FirstOrderModel
    layout: Hashable = ()
    """What tells apart models with the same list of expressions."""

    @property
    def expressions(self) -> list[Expression]:
        """Every expression of the model."""
        return [parse(entry) for entry in self.model.dynamics.values()]

    def rate(self, scope: dict[str, Any], backend: Backend) -> list[Any]:
        """Evaluate f, one value a state."""
        return [
            parse(self.model.dynamics[name]).evaluate(scope, backend.functions) for name in self.model.states
        ]


@dataclass(frozen=True)
class MechanicalDynamics:
    """M(q) q'' + C(q, q') q' + K q = G u + f(q, q', t) with n coordinates; states are (q, q')."""

    model: MechanicalModel

    @property
    def expressions(self) -> list[Expression]:
        """Every expression of the model."""
        model = self.model
        matrices = (model.mass, model.damping or (), model.stiffness or (), model.input, (model.force or (),))
        return [parse(entry) for matrix in matrices for row in matrix for entry in row]

    @property
    def layout(self) -> Hashable:
        """Which of the optional matrices there are: what tells apart models with the same expressions."""
        return tuple(part is None for part in (self.model.damping, self.model.stiffness, self.model.force))

    @property
    def coordinates(self) -> int:
        """The number n of coordinates."""
        return len(self.model.coordinates)

    def residual(self, acceleration: Values, scope: dict[str, Any], backend: Backend) -> list[Any]:
        """Evaluate M q'' + C q' + K q - G u - f, one value a coordinate."""
        loads = self._loads(scope, backend)
        mass = self._matrix(self.model.mass, scope, backend)
        return [_dot(row, acceleration) - load for row, load in zip(mass, loads, strict=True)]

    def rate(self, scope: dict[str, Any], backend: Backend) -> list[Any]:
        """Evaluate (q', M^-1 (G u + f - C q' - K q)), one value a state."""
        velocities = [scope[name] for name in self.model.states[self.coordinates :]]
        mass = self._matrix(self.model.mass, scope, backend)
        return [*velocities, *backend.solve(mass, self._loads(scope, backend))]

    def _loads(self, scope: dict[str, Any], backend: Backend) -> list[Any]:
        """G u + f - C q' - K q."""
        model = self.model
        positions = [scope[name] for name in model.coordinates]
        velocities = [scope[name] for name in model.states[self.coordinates :]]
        controls = [scope[name] for name in model.controls]
        terms = [_products(self._matrix(model.input, scope, backend), controls)]
        if model.damping is not None:
            terms.append(
                [-value for value in _products(self._matrix(model.damping, scope, backend), velocities)]
            )
        if model.stiffness is not None:
            terms.append(
                [-value for value in _products(self._matrix(model.stiffness, scope, backend), positions)]
            )
        if model.force is not None:
            terms.append([parse(entry).evaluate(scope, backend.functions) for entry in model.force])
        return [sum(parts) for parts in zip(*terms, strict=True)]

    @staticmethod
    def _matrix(rows: Sequence[Sequence[Any]], scope: dict[str, Any], backend: Backend) -> list[list[Any]]:
        return [[parse(entry).evaluate(scope, backend.functions) for entry in row] for row in rows]


@dataclass(frozen=True)
class OptimalControlProblem:
    """All of a problem; ``*_bounds`` and ends hold an interval for each state or control, in order."""

    states: tuple[str, ...]
    controls: tuple[str, ...]
    parameters: dict[str, float]
    dynamics: FirstOrderDynamics | MechanicalDynamics
    initial_time: Interval
    final_time: Interval
    initial_state: tuple[Interval, ...]
    final_state: tuple[Interval, ...]
    state_bounds: tuple[Interval, ...]
    control_bounds: tuple[Interval, ...]
    path: tuple[Constraint, ...]
    boundary: tuple[Constraint, ...]
    terminal_cost: Expression | None
    running_cost: Expression | None
    guess: Guess

    @classmethod
    def from_spec(cls, spec: ProblemSpec) -> OptimalControlProblem:
        """Build the problem of a checked document."""
        model = spec.model
        parameters = model.parameter_values()
        bounds = {name: bound_interval(bound, parameters) for name, bound in spec.bounds.items()}
        initial, final = initial_intervals(spec), final_intervals(spec)
        initial_time = bound_interval(spec.initial_time, parameters)
        final_time = bound_interval(spec.final_time, parameters)
        initial_state = tuple(initial[name] for name in model.states)
        final_state = tuple(final[name] for name in model.states)
        state_bounds = tuple(bounds.get(name, FREE) for name in model.states)
        control_bounds = tuple(bounds.get(name, FREE) for name in model.controls)
        return cls(
            states=model.states,
            controls=model.controls,
            parameters=parameters,
            dynamics=(
                MechanicalDynamics(model) if isinstance(model, MechanicalModel) else FirstOrderDynamics(model)
            ),
            initial_time=initial_time,
            final_time=final_time,
            initial_state=initial_state,
            final_state=final_state,
            state_bounds=state_bounds,
            control_bounds=control_bounds,
            path=_constraints(spec, "path_constraints", parameters),
            boundary=_constraints(spec, "boundary_constraints", parameters),
            terminal_cost=None if spec.objective.terminal is None else parse(spec.objective.terminal),
            running_cost=None if spec.objective.running is None else parse(spec.objective.running),
            guess=make_guess(
                spec.guess,
                model.states,
                model.controls,
                parameters,
                times=(initial_time, final_time),
                ends=(initial_state, final_state),
                bounds=(state_bounds, control_bounds),
            ),
        )

    @property
    def structure(self) -> Hashable:
        """Names and expressions: all that a program is made of but numbers."""
        costs = [item and item.text for item in (self.terminal_cost, self.running_cost)]
        return (
            type(self.dynamics).__name__,
            self.states,
            self.controls,
            tuple(self.parameters),
            self.dynamics.layout,
            tuple(item.text for item in self.dynamics.expressions),
            tuple(item.expression.text for item in self.path),
            tuple(item.expression.text for item in self.boundary),
            tuple(costs),
        )

    @property
    def autonomous(self) -> bool:
        """Whether neither the model nor the running cost names the time."""
        running = [] if self.running_cost is None else [self.running_cost]
        return not any("t" in expression.names for expression in [*self.dynamics.expressions, *running])

    def rate(self, x: Values, u: Values, t: Any, parameters: Parameters, backend: Backend) -> list[Any]:
        """Evaluate f(x, u, t), one value a state."""
        return self.dynamics.rate(self.scope(x, u, t, parameters), backend)

    def rates_at(self, trajectory: Trajectory, tau: Vector) -> Vector:
        """Evaluate f along a trajectory at K normalised times, (n, K); not finite where the model is not."""
        x, u, t = trajectory.states_at(tau), trajectory.controls_at(tau), trajectory.time(tau)
        with np.errstate(all="ignore"):
            rates = self.rate(x, u, t, self.parameters, NUMPY)
        return np.array(np.broadcast_arrays(*rates, t)[:-1], np.float64)

    def scope(self, x: Values, u: Values, t: Any, parameters: Parameters) -> dict[str, Any]:
        """Name the values of one instant as expressions of the trajectory know them."""
        return {
            **parameters,
            **dict(zip(self.states, x, strict=True)),
            **dict(zip(self.controls, u, strict=True)),
            "t": t,
        }

    def ends_scope(
        self,
        initial: tuple[Values, Values, Any],
        final: tuple[Values, Values, Any],
        parameters: Parameters,
    ) -> dict[str, Any]:
        """Name the (states, controls, time) of both ends as expressions of the ends know them."""
        scope = {**parameters, "t0": initial[2], "tf": final[2]}
        for suffix, (x, u, _) in (("_0", initial), ("_f", final)):
            scope |= {name + suffix: value for name, value in zip(self.states, x, strict=True)}
            scope |= {name + suffix: value for name, value in zip(self.controls, u, strict=True)}
        return scope


def _constraints(spec: ProblemSpec, key: str, parameters: dict[str, float]) -> tuple[Constraint, ...]:
    return tuple(
        Constraint(
            item.name or f"{key}/{index}",
            f"/problem/{key}/{index}",
            parse(item.expression),
            bound_interval(item.bounds, parameters),
        )
        for index, item in enumerate(getattr(spec, key))
    )


def _products(matrix: Sequence[Values], vector: Values) -> list[Any]:
    return [_dot(row, vector) for row in matrix]


def _dot(row: Values, vector: Values) -> Any:
    return sum(
        (entry * value for entry, value in zip(row, vector, strict=True) if not _is_zero(entry)), start=0.0
    )


def _is_zero(entry: Any) -> bool:
    return isinstance(entry, float) and entry == 0.0
