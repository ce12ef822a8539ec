"""Some flights side by side: over one leg and on without control, watched at many instants."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.expressions import Expression
from solvers.flights.commands import Commands, inside
from solvers.flights.draws import Draws
from solvers.flights.flown import Extremes, Flown, Missed
from solvers.flights.model import Fleet
from solvers.flights.population import NODES, Population
from solvers.formulation.elastic import Wish
from solvers.formulation.quantities import Constraint, NamedQuantity
from solvers.formulation.time_knots import corner_times
from solvers.output.coast import SAMPLES as COAST_SAMPLES
from solvers.problem import End
from solvers.verification.legs import Leg
from solvers.verification.violations import SMALLEST_SCALE

Vector = NDArray[np.float64]

RTOL = 1e-10
SAMPLES = 201
"""Instants of a flight, besides the jumps of its commands, at which limits and outputs are looked at."""
# An instant so near to a jump (as a part of the flight) is the jump itself.
_TOUCHING = 1e-9

Watch = Callable[[float, int], None]
"""Told the time and the number of steps so far; raises where there is no reason to go on."""


@dataclass(frozen=True)
class Begin:
    """How a leg begins in P flights: what is known of its states (P,), the others as promised.

    ``given``: what lagging actuators of the leg before give (P,); ``lost``: were given up before.
    """

    states: Mapping[str, Vector]
    given: Mapping[str, Vector]
    lost: NDArray[np.bool_]


@dataclass(frozen=True)
class Ends:
    """What is known at both ends of a leg in P flights: states (n, P), controls (m, P), time; by name the
    parameters, the integrals (P,), and what lagging actuators give (P,)."""

    initial: End
    final: End
    parameters: Mapping[str, Any]
    integrals: Mapping[str, Vector]
    given: Mapping[str, Vector]
    peak: Vector | None = None


@dataclass(frozen=True)
class Peak:
    """The largest value of an expression so far, of each flight (P,)."""

    expression: Expression
    values: Vector

    @classmethod
    def of(cls, expression: Expression | None, flights: int) -> Peak | None:
        """That of an expression of which nothing was seen yet; None of none."""
        return None if expression is None else cls(expression, np.full(flights, -np.inf))

    def see(self, scope: Mapping[str, Any]) -> None:
        """Take note of an instant."""
        np.fmax(self.values, evaluated(self.expression, scope, self.values.shape), out=self.values)


class Block:
    """One leg of the undisturbed flight, and of one for each run that was drawn, from ``start`` to ``stop``.

    ``lags``: of actuators by control; ``limits``: of this leg; ``peak``: what costs by its largest value over
    several legs.
    """

    def __init__(
        self,
        leg: Leg,
        span: tuple[float, float],
        commands: Commands,
        lags: Mapping[str, float],
        draws: Draws,
        limits: Sequence[Wish],
        begin: Begin,
        peak: Expression | None = None,
    ) -> None:
        problem, answer = leg.problem, leg.answer
        self._leg, self._problem, self._span, self._limits = leg, problem, span, limits
        self._breakpoints, self._commands = commands.breakpoints(*span), commands.told(problem.controls)
        design = [
            with_first(answer.design.get(item.name, item.guess), draws.parameters.get(item.name), draws.runs)
            for item in problem.design
        ]
        self._fleet = Fleet(
            problem,
            np.array(design).reshape(-1, 1 + draws.runs),
            np.array([lags.get(name, 0.0) for name in problem.controls]),
        )
        tau = np.zeros(1)
        states = [
            begin.states.get(name, np.full(1 + draws.runs, float(answer.states[name](tau)[0])))
            for name in problem.states
        ]
        self._start = self._fleet.begin(np.array(states).reshape(-1, 1 + draws.runs), begin.given)
        promised = np.array([answer.states[name](answer.breakpoints) for name in problem.states])
        self._scales = np.maximum(SMALLEST_SCALE, np.abs(promised).max(axis=1))
        largest = np.maximum(self._scales, np.abs(self._start[: len(states)]).max(axis=1))
        told = np.maximum(SMALLEST_SCALE, commands.sizes(problem.controls))
        sizes = self._fleet.sizes(largest, told)
        self._population = Population(self._start, sizes, RTOL, self._begin, self._rate, begin.lost)
        rated = set(problem.controls) - set(answer.controls)
        self._outputs = [item for item in problem.outputs if not _names_rate(item, rated)]
        self._own_peak, self._peak = (Peak.of(cost, 1 + draws.runs) for cost in (problem.peak_cost, peak))
        self._extremes = Extremes()
        self._excess = {index: np.zeros(1 + draws.runs) for index, wish in enumerate(limits) if wish.along}
        self._largest = dict.fromkeys(self._excess, 0.0)

    def fly(self, watch: Watch) -> tuple[Flown, Ends]:
        """Fly this leg. Raises what ``watch`` raises, which is told the time and the number of steps."""
        begin, end = self._span
        self._watch = watch
        corners = corner_times(self._problem)
        stops = _stops(self._breakpoints, np.append(corners, np.linspace(begin, end, SAMPLES)))
        controls = first = self._felt(stops[0], stops[1], 0.0)
        self._look(begin, first)
        for start, stop in pairwise(stops):
            self._population.advance(start, stop)
            controls = self._felt(start, stop, 1.0)
            self._look(stop, controls)
        states = self._population.states
        final = states[: self._fleet.states].copy()
        integrals = self._fleet.integrals(states)
        ends = Ends(
            (self._start[: self._fleet.states], first, begin),
            (final, controls, end),
            self._fleet.parameters,
            {item.name: row.copy() for item, row in zip(self._problem.integrals, integrals[1:], strict=True)},
            self._fleet.given(states),
            None if self._peak is None else self._peak.values,
        )
        scope = self._fleet.ends_scope(ends.initial, ends.final, [*ends.integrals.values()])
        cost = self._problem.terminal_cost
        terminal = 0.0 if cost is None else cost.evaluate(scope, NUMPY.functions)
        flown = Flown(
            self._population.lost.copy(),
            dict(zip(self._problem.states, final, strict=True)),
            self._values(final, controls, end),
            self._extremes,
            integrals[0] + terminal + (0.0 if self._own_peak is None else self._own_peak.values),
            [
                self._along(index, wish) if wish.along else self._at_end(wish, scope)
                for index, wish in enumerate(self._limits)
            ],
            {},
            end,
            self._population.steps,
        )
        return flown, ends

    def coast(self, flown: Flown, seconds: float, *, decay: bool) -> Flown:
        """Fly on without control after the leg was flown.

        ``decay``: what the actuators give dies away, else they are switched off.
        """
        _, end = self._span
        if not decay:
            self._fleet.switch_off(self._population.states)
        seen, times = Extremes(), np.linspace(end, end + seconds, COAST_SAMPLES)
        for start, stop in pairwise([end, *_stops(times, corner_times(self._problem))]):
            self._population.advance(start, stop)
            states = self._population.states
            felt = self._fleet.controls(states, np.zeros(len(self._problem.controls)))
            named = dict(zip(self._problem.states, states[: self._fleet.states], strict=True))
            seen.see({**named, **self._values(states, felt, stop)})
        return replace(
            flown,
            lost=self._population.lost.copy(),
            swings=seen.amplitudes(),
            steps=self._population.steps,
        )

    def _begin(self, start: float, length: float) -> None:
        self._watch(start, self._population.steps)
        self._times = inside(start, start + length, NODES)
        self._told = self._commands.at(self._times)

    def _rate(self, stage: int, states: Vector, rates: Vector) -> None:
        self._fleet.rate(states, self._told[:, stage], self._times[stage], rates)

    def _felt(self, start: float, stop: float, part: float) -> Vector:
        """The controls (m, P) at a part of a step."""
        told = self._commands.at(inside(start, stop, np.array([part])))[:, 0]
        return self._fleet.controls(self._population.states, told)

    def _look(self, t: float, controls: Vector) -> None:
        """Take note of outputs and of limits along the flight at an instant."""
        states = self._population.states
        self._extremes.see(self._values(states, controls, t))
        begin, end = self._span
        tau = np.array([(t - begin) / (end - begin)])
        scope = self._fleet.scope(states, controls, t)
        for peak in (self._own_peak, self._peak):
            if peak is not None:
                peak.see(scope)
        for index, excess in self._excess.items():
            limit = self._limits[index].limit
            if limit.holds_at(tau)[0]:
                values = evaluated(limit.expression, scope, excess.shape)
                self._excess[index] = np.maximum(excess, limit.excess(values))
                self._largest[index] = max(self._largest[index], abs(float(values[0])))

    def _values(self, states: Vector, controls: Vector, t: float) -> dict[str, Vector]:
        """The outputs at an instant."""
        if not self._outputs:
            return {}
        scope = self._fleet.scope(states, controls, t)
        return {
            item.name: evaluated(item.expression, scope, states.shape[1:]).copy() for item in self._outputs
        }

    def _along(self, index: int, wish: Wish) -> Missed:
        return self._missed(wish, self._largest[index], self._excess[index])

    def _at_end(self, wish: Wish, scope: Mapping[str, Any]) -> Missed:
        values = evaluated(wish.limit.expression, scope, self._population.lost.shape)
        return self._missed(wish, abs(float(values[0])), wish.limit.excess(values))

    def _missed(self, wish: Wish, largest: float, excess: Vector) -> Missed:
        limit = wish.limit
        return Missed(self._leg.located(limit.pointer), limit.name, self._scale(wish, largest), excess)

    def _scale(self, wish: Wish, largest: float) -> float:
        """What a miss is compared with: the largest magnitude on the promised or the undisturbed flight."""
        name, states = wish.limit.name, self._problem.states
        if name in states and wish.limit.expression.names <= {name, f"{name}_f"}:
            return float(self._scales[states.index(name)])
        return scale_of_limit(wish.limit, largest)


def scale_of_limit(limit: Constraint, largest: float) -> float:
    """The magnitude of a limit, or that of its expression on the undisturbed flight if that is larger."""
    sides = [abs(side) for side in limit.interval if np.isfinite(side)]
    return max(SMALLEST_SCALE, largest, *sides)


def with_first(nominal: float, drawn: Vector | None, runs: int) -> Vector:
    """The undisturbed value, then those of all runs."""
    return np.append(nominal, np.full(runs, nominal) if drawn is None else drawn)


def _stops(breakpoints: Vector, times: Vector) -> Vector:
    """The breakpoints, and all times between the first and the last that are none already."""
    start, end = breakpoints[0], breakpoints[-1]
    times = times[(times > start) & (times < end)]
    after = np.clip(np.searchsorted(breakpoints, times), 1, breakpoints.size - 1)
    nearest = np.minimum(np.abs(times - breakpoints[after - 1]), np.abs(breakpoints[after] - times))
    return np.union1d(breakpoints, times[nearest > _TOUCHING * (end - start)])


def evaluated(expression: Expression, scope: Mapping[str, Any], shape: tuple[int, ...]) -> Vector:
    """The values of an expression for all flights, (P,)."""
    with np.errstate(all="ignore"):
        values = expression.evaluate(scope, NUMPY.functions)
    return np.asarray(np.broadcast_to(values, shape), np.float64)


def _names_rate(item: NamedQuantity, rated: set[str]) -> bool:
    return not item.expression.names.isdisjoint({f"{name}_dot" for name in rated})
