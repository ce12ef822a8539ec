"""Some flights side by side: over the whole flight and on without control, watched at many instants."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.coast import SAMPLES as COAST_SAMPLES
from solvers.elastic import Wish
from solvers.expressions import Expression
from solvers.flights.commands import Commands, inside
from solvers.flights.draws import Draws
from solvers.flights.model import Fleet
from solvers.flights.population import NODES, Population
from solvers.problem import OptimalControlProblem
from solvers.quantities import NamedQuantity
from solvers.time_knots import corner_times
from solvers.trajectory import Trajectory
from solvers.violations import SMALLEST_SCALE

Vector = NDArray[np.float64]

RTOL = 1e-10
SAMPLES = 201
"""Instants of a flight, besides the jumps of its commands, at which limits and outputs are looked at."""
# An instant so near to a jump (as a part of the flight) is the jump itself.
_TOUCHING = 1e-9

Watch = Callable[[float, int], None]
"""Told the part that is done and the number of steps; raises where there is no reason to go on."""


@dataclass
class Extremes:
    """Smallest and largest value so far of each flight (P,), by name."""

    low: dict[str, Vector] = field(default_factory=dict)
    high: dict[str, Vector] = field(default_factory=dict)

    def see(self, values: Mapping[str, Vector]) -> None:
        """Take note of an instant."""
        for name, row in values.items():
            self.low[name] = np.minimum(self.low.get(name, row), row)
            self.high[name] = np.maximum(self.high.get(name, row), row)

    def amplitudes(self) -> dict[str, Vector]:
        """Half of the distance between both, by name."""
        return {name: (self.high[name] - self.low[name]) / 2.0 for name in self.low}


@dataclass(frozen=True)
class Missed:
    """A limit of the document, its ``scale``, and by how much each flight misses it (P,)."""

    limit: Wish
    scale: float
    excess: Vector


@dataclass(frozen=True)
class Flown:
    """What P flights did, each value (P,); the first is the undisturbed one.

    ``lost``: could not be followed to the end. ``final`` and ``outputs``: at the end of the flight;
    ``extremes``: of the outputs on it; ``swings``: the amplitudes of states and outputs after it.
    """

    lost: NDArray[np.bool_]
    final: Mapping[str, Vector]
    outputs: Mapping[str, Vector]
    extremes: Extremes
    objective: Vector
    missed: Sequence[Missed]
    swings: Mapping[str, Vector]
    end: float
    steps: int


class Block:
    """The undisturbed flight, and one for each run that was drawn, from their starts."""

    def __init__(
        self,
        problem: OptimalControlProblem,
        answer: Trajectory,
        commands: Commands,
        lags: Vector,
        draws: Draws,
        limits: Sequence[Wish],
    ) -> None:
        self._problem, self._commands, self._limits = problem, commands, limits
        design = [
            _with_first(answer.design.get(item.name, item.guess), draws.parameters.get(item.name), draws.runs)
            for item in problem.design
        ]
        self._fleet = Fleet(problem, np.array(design).reshape(-1, 1 + draws.runs), lags)
        start = np.zeros(1)
        states = [
            _with_first(float(answer.states[name](start)[0]), draws.initial_state.get(name), draws.runs)
            for name in problem.states
        ]
        self._start = np.zeros((self._fleet.size, 1 + draws.runs))
        self._start[: len(states)] = states
        promised = np.array([answer.states[name](answer.breakpoints) for name in problem.states])
        self._scales = np.maximum(SMALLEST_SCALE, np.abs(promised).max(axis=1))
        largest = np.maximum(self._scales, np.abs(self._start[: len(states)]).max(axis=1))
        told = np.maximum(SMALLEST_SCALE, commands.sizes(problem.controls))
        sizes = self._fleet.sizes(largest, told)
        self._population = Population(self._start, sizes, RTOL, self._begin, self._rate)
        rated = set(problem.controls) - set(answer.controls)
        self._outputs = [item for item in problem.outputs if not _names_rate(item, rated)]
        self._extremes = Extremes()
        self._excess = {index: np.zeros(1 + draws.runs) for index, wish in enumerate(limits) if wish.along}
        self._largest = dict.fromkeys(self._excess, 0.0)

    def fly(self, coast: float | None, watch: Watch, *, decay: bool = False) -> Flown:
        """Fly, then on for ``coast`` seconds without control; ``decay``: what the actuators give dies away.

        Raises what ``watch`` raises.
        """
        begin, end = self._commands.start, self._commands.end
        whole = end - begin + (coast or 0.0)

        def tell(t: float) -> None:
            watch((t - begin) / whole, self._population.steps)

        self._tell = tell
        corners = corner_times(self._problem)
        stops = _stops(
            self._commands.breakpoints(begin, end), np.append(corners, np.linspace(begin, end, SAMPLES))
        )
        controls = first = self._felt(stops[0], stops[1], 0.0)
        self._look(begin, first)
        for start, stop in pairwise(stops):
            self._population.advance(start, stop)
            controls = self._felt(start, stop, 1.0)
            self._look(stop, controls)
        states = self._population.states
        final = states[: self._fleet.states].copy()
        scope = self._fleet.ends_scope(
            (self._start[: self._fleet.states], first, begin),
            (final, controls, end),
            self._fleet.integrals(states)[1:].copy(),
        )
        cost = self._problem.terminal_cost
        terminal = 0.0 if cost is None else cost.evaluate(scope, NUMPY.functions)
        objective = self._fleet.integrals(states)[0] + terminal
        outputs = self._values(final, controls, end)
        missed = [
            self._along(index, wish) if wish.along else self._at_end(wish, scope)
            for index, wish in enumerate(self._limits)
        ]
        if not decay:
            self._fleet.switch_off(states)
        swings = {} if coast is None else self._coast(end, coast)
        return Flown(
            self._population.lost.copy(),
            dict(zip(self._problem.states, final, strict=True)),
            outputs,
            self._extremes,
            objective,
            missed,
            swings,
            end,
            self._population.steps,
        )

    def _coast(self, end: float, seconds: float) -> dict[str, Vector]:
        """Fly on, and return by how much states and outputs swing."""
        seen, times = Extremes(), np.linspace(end, end + seconds, COAST_SAMPLES)
        for start, stop in pairwise([end, *_stops(times, corner_times(self._problem))]):
            self._population.advance(start, stop)
            states = self._population.states
            felt = self._fleet.controls(states, np.zeros(len(self._problem.controls)))
            named = dict(zip(self._problem.states, states[: self._fleet.states], strict=True))
            seen.see({**named, **self._values(states, felt, stop)})
        return seen.amplitudes()

    def _begin(self, start: float, length: float) -> None:
        self._tell(start)
        self._times = inside(start, start + length, NODES)
        self._told = self._commands.at(self._times, self._problem.controls)

    def _rate(self, stage: int, states: Vector, rates: Vector) -> None:
        self._fleet.rate(states, self._told[:, stage], self._times[stage], rates)

    def _felt(self, start: float, stop: float, part: float) -> Vector:
        """The controls (m, P) at a part of a step."""
        told = self._commands.at(inside(start, stop, np.array([part])), self._problem.controls)[:, 0]
        return self._fleet.controls(self._population.states, told)

    def _look(self, t: float, controls: Vector) -> None:
        """Take note of outputs and of limits along the flight at an instant."""
        states = self._population.states
        self._extremes.see(self._values(states, controls, t))
        tau = np.array([(t - self._commands.start) / (self._commands.end - self._commands.start)])
        scope = self._fleet.scope(states, controls, t)
        for index, excess in self._excess.items():
            limit = self._limits[index].limit
            if limit.holds_at(tau)[0]:
                values = _evaluated(limit.expression, scope, excess.shape)
                self._excess[index] = np.maximum(excess, limit.excess(values))
                self._largest[index] = max(self._largest[index], abs(float(values[0])))

    def _values(self, states: Vector, controls: Vector, t: float) -> dict[str, Vector]:
        """The outputs at an instant."""
        if not self._outputs:
            return {}
        scope = self._fleet.scope(states, controls, t)
        return {
            item.name: _evaluated(item.expression, scope, states.shape[1:]).copy() for item in self._outputs
        }

    def _along(self, index: int, wish: Wish) -> Missed:
        return Missed(wish, self._scale(wish, self._largest[index]), self._excess[index])

    def _at_end(self, wish: Wish, scope: Mapping[str, Any]) -> Missed:
        values = _evaluated(wish.limit.expression, scope, self._population.lost.shape)
        return Missed(wish, self._scale(wish, abs(float(values[0]))), wish.limit.excess(values))

    def _scale(self, wish: Wish, largest: float) -> float:
        """What a miss is compared with: the largest magnitude on the promised or the undisturbed flight."""
        name, states = wish.limit.name, self._problem.states
        if name in states and wish.limit.expression.names <= {name, f"{name}_f"}:
            return float(self._scales[states.index(name)])
        sides = [abs(side) for side in wish.limit.interval if np.isfinite(side)]
        return max(SMALLEST_SCALE, largest, *sides)


def _with_first(nominal: float, drawn: Vector | None, runs: int) -> Vector:
    """The undisturbed value, then those of all runs."""
    return np.append(nominal, np.full(runs, nominal) if drawn is None else drawn)


def _stops(breakpoints: Vector, times: Vector) -> Vector:
    """The breakpoints, and all times between the first and the last that are none already."""
    start, end = breakpoints[0], breakpoints[-1]
    times = times[(times > start) & (times < end)]
    after = np.clip(np.searchsorted(breakpoints, times), 1, breakpoints.size - 1)
    nearest = np.minimum(np.abs(times - breakpoints[after - 1]), np.abs(breakpoints[after] - times))
    return np.union1d(breakpoints, times[nearest > _TOUCHING * (end - start)])


def _evaluated(expression: Expression, scope: Mapping[str, Any], shape: tuple[int, ...]) -> Vector:
    with np.errstate(all="ignore"):
        values = expression.evaluate(scope, NUMPY.functions)
    return np.asarray(np.broadcast_to(values, shape), np.float64)


def _names_rate(item: NamedQuantity, rated: set[str]) -> bool:
    return not item.expression.names.isdisjoint({f"{name}_dot" for name in rated})
