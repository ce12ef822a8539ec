"""An optimal-control problem as numbers and callables, whatever they are evaluated over.

Minimise  phi(x(t0), u(t0), x(tf), u(tf), I, p, t0, tf) + integral of L(x, u, p, t) dt  subject to
x' = f(x, u, p, t), bounds on states, controls, times and ends, path constraints h(x, u, p, t), boundary
constraints, integrals I of g(x, u, p, t) and design parameters p. A model of second order also gives its
residual  M(q) q'' + C(q, q') q' + K q - G u - f(q, q', t).

Every callable takes lists of values (floats, NumPy arrays of one shape, CasADi symbols), the parameters by
name, and the backend to which the values belong.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY, Backend
from solvers.expressions import Expression, parse, product, total
from solvers.formulation.dynamics import Dynamics, NodeScope
from solvers.formulation.quantities import (
    WHOLE_SPAN,
    Constraint,
    DesignParameter,
    Integral,
    Interval,
    NamedQuantity,
)
from solvers.models import Formula
from solvers.start.guess import Guess, Start
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]
Values = Sequence[Any] | Vector
"""One value a state, coordinate or control; rows of an array where these are arrays."""
Parameters = Mapping[str, Any]
End = tuple[Values, Values, Any]
"""States, controls and time."""

_ROUGH_SAMPLES = 129


@dataclass(frozen=True)
class OptimalControlProblem:
    """All of a problem; ``*_bounds`` and ends hold an interval for each state or control, in order.

    ``rated``: the controls of the document that are the last states here, for it is their rates that are
    chosen; their place among the controls is taken by ``<name>_dot``.
    """

    states: tuple[str, ...]
    controls: tuple[str, ...]
    parameters: dict[str, float]
    dynamics: Dynamics
    definitions: Mapping[str, Formula]
    initial_time: Interval
    final_time: Interval
    initial_state: tuple[Interval, ...]
    final_state: tuple[Interval, ...]
    state_bounds: tuple[Interval, ...]
    control_bounds: tuple[Interval, ...]
    initial_control: tuple[Interval, ...]
    final_control: tuple[Interval, ...]
    path: tuple[Constraint, ...]
    boundary: tuple[Constraint, ...]
    terminal_cost: Expression | None
    running_cost: Expression | None
    outputs: tuple[NamedQuantity, ...]
    guess: Guess
    integrals: tuple[Integral, ...] = ()
    design: tuple[DesignParameter, ...] = ()
    rated: tuple[str, ...] = ()
    peak_cost: Expression | None = None

    def bound_pointer(self, name: str) -> str:
        """The place in the document where the bounds of a state or control stand."""
        for control in self.rated:
            if name == f"{control}_dot":
                return f"/problem/control_rates/{control}"
        return f"/problem/bounds/{name}"

    @property
    def structure(self) -> Hashable:
        """Names and expressions: all that a program is made of but numbers."""
        costs = [item and item.text for item in (self.terminal_cost, self.running_cost)]
        return (
            self.states,
            self.controls,
            tuple(self.parameters),
            self.dynamics.layout,
            tuple(item.text for item in self.dynamics.expressions),
            tuple((name, item.text) for name, item in self.definitions.items()),
            tuple((item.expression.text, item.during) for item in self.path),
            tuple(item.expression.text for item in self.boundary),
            tuple((item.name, item.expression.text) for item in self.integrals),
            tuple(item.name for item in self.design),
            self.rated,
            tuple((item.name, item.expression.text) for item in self.outputs),
            tuple(costs),
        )

    @property
    def autonomous(self) -> bool:
        """Whether nothing that holds along the trajectory names the time, or a part of it."""
        running = [] if self.running_cost is None else [self.running_cost]
        limits = [item.expression for item in self.path]
        every = [*self.dynamics.expressions, *self.definitions.values(), *running, *limits]
        windows = any(item.during != WHOLE_SPAN for item in self.path)
        return not windows and not any("t" in expression.names for expression in every)

    def parameters_of(self, trajectory: Trajectory) -> dict[str, float]:
        """The parameters of an answer: those of the document, design parameters as they were found."""
        return {**self.parameters, **trajectory.design}

    def with_integrals_in_cost(self, weights: Vector) -> OptimalControlProblem:
        """The problem whose running cost also has each integrand times its weight.

        With the multipliers of the integrals as weights its Hamiltonian is that of the whole problem.
        """
        if not self.integrals:
            return self
        terms = [] if self.running_cost is None else [self.running_cost]
        terms += [
            product(parse(float(weight)), item.expression)
            for weight, item in zip(weights, self.integrals, strict=True)
        ]
        return replace(self, running_cost=total(terms))

    def integrals_along(self, start: Start) -> Vector:
        """The integrals along a start, roughly: where their unknowns begin; 0 where they are not finite."""
        if not self.integrals:
            return np.empty(0)
        tau = np.linspace(0.0, 1.0, _ROUGH_SAMPLES)
        t = start.t0 + (start.tf - start.t0) * tau
        parameters = {**self.parameters, **start.design}
        scope = self.scope(start.states_at(tau), start.controls_at(tau), t, parameters, NUMPY)
        with np.errstate(all="ignore"):
            values = [item.expression.evaluate(scope, NUMPY.functions) for item in self.integrals]
        found = [np.trapezoid(np.broadcast_to(value, tau.shape), t) for value in values]
        return np.nan_to_num(np.array(found, np.float64), posinf=0.0, neginf=0.0)

    def rate(self, x: Values, u: Values, t: Any, parameters: Parameters, backend: Backend) -> list[Any]:
        """Evaluate f(x, u, t), one value a state."""
        return self.dynamics.rate(self.scope(x, u, t, parameters, backend), backend)

    def rates_at(self, trajectory: Trajectory, tau: Vector) -> Vector:
        """Evaluate f along a trajectory at K normalised times, (n, K); not finite where the model is not."""
        x, u, t = trajectory.states_at(tau), trajectory.controls_at(tau), trajectory.time(tau)
        with np.errstate(all="ignore"):
            rates = self.rate(x, u, t, self.parameters_of(trajectory), NUMPY)
        return np.array(np.broadcast_arrays(*rates, t)[:-1], np.float64)

    def scope(self, x: Values, u: Values, t: Any, parameters: Parameters, backend: Backend) -> NodeScope:
        """Name the values of one instant as expressions of the trajectory know them."""
        given = {
            **parameters,
            **dict(zip(self.states, x, strict=True)),
            **dict(zip(self.controls, u, strict=True)),
            "t": t,
        }
        return NodeScope(given, self.dynamics, self.definitions, backend)

    def outputs_at(self, trajectory: Trajectory, tau: Vector) -> dict[str, Vector]:
        """The outputs along a trajectory at K normalised times, by name; not finite where they are not."""
        if not self.outputs:
            return {}
        x, u, t = trajectory.states_at(tau), trajectory.controls_at(tau), trajectory.time(tau)
        scope = self.scope(x, u, t, self.parameters_of(trajectory), NUMPY)
        with np.errstate(all="ignore"):
            values = [item.expression.evaluate(scope, NUMPY.functions) for item in self.outputs]
        return {
            item.name: np.array(np.broadcast_to(value, tau.shape), np.float64)
            for item, value in zip(self.outputs, values, strict=True)
        }

    def ends_scope(
        self,
        initial: End,
        final: End,
        parameters: Parameters,
        backend: Backend,
        integrals: Values = (),
        wanted: Collection[str] | None = None,
    ) -> dict[str, Any]:
        """Name the (states, controls, time) of both ends and the integrals as expressions there know them.

        ``wanted``: names among which outputs are looked for; by default those of the document's expressions.
        """
        wanted = self.named_at_the_ends if wanted is None else wanted
        return {
            **self.end_scope(final, parameters, backend, wanted),
            **self.begin_scope(initial),
            **{item.name: value for item, value in zip(self.integrals, integrals, strict=True)},
        }

    def begin_scope(self, begin: End) -> dict[str, Any]:
        """Name what is known at the begin: states, controls, t0."""
        x, u, t = begin
        return {**self._named("_0", x, u), "t0": t}

    def end_scope(
        self, end: End, parameters: Parameters, backend: Backend, wanted: Collection[str]
    ) -> dict[str, Any]:
        """Name what is known at the end: parameters, states, controls, tf; if they are wanted, outputs.

        And what follows from unknown parameters, which is a definition.
        """
        x, u, t = end
        scope = {**parameters, **self._named("_f", x, u), "tf": t}
        along = self.scope(x, u, t, parameters, backend)
        scope |= {name: along[name] for name in self.definitions if name in wanted}
        for item in self.outputs:
            if f"{item.name}_f" in wanted:
                scope[f"{item.name}_f"] = item.expression.evaluate(along, backend.functions)
        return scope

    def _named(self, suffix: str, x: Values, u: Values) -> dict[str, Any]:
        names = (name + suffix for name in (*self.states, *self.controls))
        return dict(zip(names, (*x, *u), strict=True))

    @property
    def named_at_the_ends(self) -> frozenset[str]:
        """Every name in a boundary constraint or the terminal cost."""
        return names_of(self.at_the_ends)

    @property
    def at_the_ends(self) -> list[Expression]:
        """What is evaluated at the ends."""
        return at_the_ends(self.boundary, self.terminal_cost)


def at_the_ends(boundary: Sequence[Constraint], terminal_cost: Expression | None) -> list[Expression]:
    """What is evaluated at the ends: the boundary constraints, then the terminal cost if there is one."""
    return [*(item.expression for item in boundary), *([] if terminal_cost is None else [terminal_cost])]


def names_of(expressions: Iterable[Expression]) -> frozenset[str]:
    """Every name in these expressions."""
    return frozenset().union(*(expression.names for expression in expressions))
