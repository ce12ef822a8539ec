"""The simple model as predictions and tracking need it: which states the controls move, compiled functions.

States that no control reaches, directly or through others, are *exogenous*: over a segment of known length
they are computed beforehand, and so is what the library computes from them and the time alone. Predictions
then hold the *driven* states only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.formulation.dynamics import NodeScope
from solvers.models.computed import Whole
from solvers.problem import OptimalControlProblem
from solvers.symbolic import CASADI

Vector = NDArray[np.float64]

# Fixed steps of the classical Runge-Kutta method between two instants of a mesh: these states are slow.
_STEPS = 2


@dataclass(frozen=True)
class SimpleModel:
    """A problem's model with the numbers of its parameters built in.

    ``known_times``: whether segments have known lengths, so that exogenous states can be computed beforehand.
    """

    problem: OptimalControlProblem
    known_times: bool

    @cached_property
    def driven(self) -> tuple[int, ...]:
        """Indices of the driven states: all where the lengths of segments are not known."""
        count = len(self.problem.states)
        if not self.known_times:
            return tuple(range(count))
        x, u, t = self._symbols
        rate = ca.vertcat(*self._rate(x, u, t))
        by_state, by_control = (
            np.array(ca.DM(ca.jacobian_sparsity(rate, over), 1).full(), bool) for over in (x, u)
        )
        reached = by_control.any(axis=1)
        for _ in range(count):
            reached |= by_state[:, reached].any(axis=1)
        return tuple(np.flatnonzero(reached).tolist())

    @cached_property
    def exogenous(self) -> tuple[int, ...]:
        """Indices of the other states."""
        return tuple(index for index in range(len(self.problem.states)) if index not in self.driven)

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Names of what the library computes from exogenous states and the time alone."""
        definitions = self.problem.definitions.items()
        return tuple(
            name for name, formula in definitions if not self._known_wholes.isdisjoint(formula.names)
        )

    @cached_property
    def _known_wholes(self) -> frozenset[str]:
        """What the library computes as a whole (`solvers.models.computed`) and is known beforehand."""
        if not self.known_times:
            return frozenset()
        known = {self.problem.states[index] for index in self.exogenous} | {"t"}
        return frozenset(
            name
            for name, formula in self.problem.definitions.items()
            if isinstance(formula, Whole) and formula.names <= known
        )

    @property
    def numbers(self) -> int:
        """How many numbers describe an instant beforehand: exogenous states, signals, time."""
        return len(self.exogenous) + len(self.signals) + 1

    def scope(self, x: Sequence[Any], u: Sequence[Any], numbers: Sequence[Any]) -> NodeScope:
        """The names of an instant over symbols: driven states, controls, and the numbers beforehand."""
        problem = self.problem
        names = [problem.states[index] for index in self.exogenous] + list(self.signals) + ["t"]
        given: dict[str, Any] = {
            **problem.parameters,
            **dict(zip((problem.states[index] for index in self.driven), x, strict=True)),
            **dict(zip(problem.controls, u, strict=True)),
            **dict(zip(names, numbers, strict=True)),
        }
        definitions = {
            name: formula
            for name, formula in problem.definitions.items()
            if name not in given and name not in self._known_wholes
        }
        return NodeScope(given, problem.dynamics, definitions, CASADI)

    def driven_rate(self, scope: NodeScope) -> list[Any]:
        """Rates of the driven states."""
        rates = self.problem.dynamics.rate(scope, CASADI)
        return [rates[index] for index in self.driven]

    @cached_property
    def slopes(self) -> ca.Function:
        """(driven states, controls, numbers) -> A (n, n), B (n, m)."""
        x, u, numbers = self._driven_symbols
        rate = self._rate_beside(x, u, numbers)
        slopes = [ca.densify(ca.jacobian(rate, over)) for over in (x, u)]
        return ca.Function("slopes", [x, u, numbers], slopes, {"cse": True})

    @cached_property
    def rate_between(self) -> ca.Function:
        """(driven states, controls, time, numbers at three instants) -> rates of the driven states.

        Between the instants, one after the other at equal distances, numbers are a parabola.
        """
        x, u, numbers = self._driven_symbols
        t, known = ca.SX.sym("t"), ca.SX.sym("known", self.numbers, 3)
        first, middle, last = ca.horzsplit(known)
        part = 2 * (t - first[-1]) / (last[-1] - first[-1]) - 1  # -1, 0 and 1 at the instants
        between = middle + part / 2 * (last - first) + part**2 / 2 * (first - 2 * middle + last)
        rate = ca.Function("driven_rate", [x, u, numbers], [self._rate_beside(x, u, numbers)])
        return ca.Function("rate", [x, u, t, ca.vec(known)], [rate(x, u, between)], {"cse": True})

    @property
    def _driven_symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        return (
            ca.SX.sym("x", len(self.driven)),
            ca.SX.sym("u", len(self.problem.controls)),
            ca.SX.sym("numbers", self.numbers),
        )

    def _rate_beside(self, x: ca.SX, u: ca.SX, numbers: ca.SX) -> ca.SX:
        """Rates of the driven states beside the numbers of their instant."""
        scope = self.scope(ca.vertsplit(x), ca.vertsplit(u), ca.vertsplit(numbers))
        return ca.vertcat(*[ca.SX(value) for value in self.driven_rate(scope)])

    def beforehand(self, state: Vector, times: Vector) -> Vector:
        """The numbers of each of K ``times`` from all states at the first one, (numbers, K)."""
        outside = self._exogenous_flow(state[list(self.exogenous)], times)
        return np.vstack([outside, self._signals_at(outside, times), times[None, :]])

    def _exogenous_flow(self, start: Vector, times: Vector) -> Vector:
        if not self.exogenous:
            return np.zeros((0, times.size))
        steps = self._exogenous_steps.get(times.size) or self._exogenous_step.mapaccum(times.size - 1)
        self._exogenous_steps[times.size] = steps
        ends = steps(start, times[None, :-1], np.diff(times)[None, :]).full()
        return np.hstack([start[:, None], ends])

    def _signals_at(self, outside: Vector, times: Vector) -> Vector:
        if not self.signals:
            return np.zeros((0, times.size))
        problem = self.problem
        x = np.zeros((len(problem.states), times.size))
        x[list(self.exogenous)] = outside
        nothing = np.zeros((len(problem.controls), times.size))
        scope = problem.scope(x, nothing, times, problem.parameters, NUMPY)
        return np.array([np.broadcast_to(scope[name], times.shape) for name in self.signals])

    @cached_property
    def _exogenous_steps(self) -> dict[int, ca.Function]:
        """The steps between so many times, which take a while to be put together."""
        return {}

    @cached_property
    def _exogenous_step(self) -> ca.Function:
        """(exogenous states, time, length) -> the states after it, by steps of the classical method."""
        x, u, t = self._symbols
        chosen = list(self.exogenous)
        rates = ca.vertcat(*[ca.SX(self._rate(x, u, t)[index]) for index in chosen])
        outside, h = ca.SX.sym("outside", len(chosen)), ca.SX.sym("h")
        whole = ca.SX.zeros(x.numel(), 1)
        rate = ca.Function("outside_rate", [x, u, t], [rates])

        def at(state: ca.SX, time: ca.SX) -> ca.SX:
            full = ca.SX(whole)
            full[chosen] = state
            return rate(full, ca.SX.zeros(u.numel(), 1), time)

        state, time, step = outside, t, h / _STEPS
        for _ in range(_STEPS):
            k1 = at(state, time)
            k2 = at(state + step / 2 * k1, time + step / 2)
            k3 = at(state + step / 2 * k2, time + step / 2)
            k4 = at(state + step * k3, time + step)
            state, time = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4), time + step
        return ca.Function("outside_step", [outside, t, h], [state])

    @cached_property
    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        problem = self.problem
        return (
            ca.SX.sym("x", len(problem.states)),
            ca.SX.sym("u", len(problem.controls)),
            ca.SX.sym("t"),
        )

    def _rate(self, x: ca.SX, u: ca.SX, t: ca.SX) -> list[ca.SX]:
        problem = self.problem
        rates = problem.rate(ca.vertsplit(x), ca.vertsplit(u), t, problem.parameters, CASADI)
        return [ca.SX(rate) for rate in rates]
