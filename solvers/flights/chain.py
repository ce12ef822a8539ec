"""Flights of a whole answer: leg after leg, each beginning where the one before has ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.expressions import parse
from solvers.flights.block import Begin, Block, Ends, Watch, evaluated, scale_of_limit, with_first
from solvers.flights.commands import Commands
from solvers.flights.draws import Draws
from solvers.flights.flown import Flown, Missed, together
from solvers.formulation.elastic import Wish
from solvers.phases.peak import peaks_of
from solvers.phases.problem import start_after
from solvers.spec import ProblemSpec
from solvers.verification.legs import Leg, Route

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """What is flown: a route whose drawn parameters are unknown numbers, under commands.

    ``lags``: of actuators by control; ``limits``: those of each leg; ``over_all``: those of the whole flight.
    """

    spec: ProblemSpec
    route: Route
    commands: Commands
    lags: Mapping[str, float]
    limits: Sequence[Sequence[Wish]]
    over_all: Sequence[Wish]

    @property
    def edges(self) -> list[float]:
        """When the first leg begins, and when each of them ends."""
        later = [leg.answer.t0 for leg in self.route.legs[1:]]
        return [self.commands.start, *later, self.commands.end]


def fly_plan(plan: Plan, draws: Draws, coast: float | None, watch: Watch, *, decay: bool) -> Flown:
    """Fly all legs, then on for ``coast`` seconds without control; ``decay``: see :meth:`Block.coast`.

    Raises what ``watch`` raises.
    """
    flown: list[Flown] = []
    ends: list[Ends] = []
    peaks = [None] if plan.route.whole is None else peaks_of(plan.route.whole)
    begin = Begin(_drawn_states(plan.route.legs[0], draws), {}, np.zeros(1 + draws.runs, bool))
    for index, (leg, span) in enumerate(zip(plan.route.legs, pairwise(plan.edges), strict=True)):
        if index:
            begin = _after(plan.route.legs[index - 1], leg, ends[-1], flown[-1])
        block = Block(leg, span, plan.commands, plan.lags, draws, plan.limits[index], begin, peaks[index])
        done, end = block.fly(watch)
        flown.append(done)
        ends.append(end)
    if coast is not None:
        flown[-1] = block.coast(flown[-1], coast, decay=decay)
    return flown[0] if plan.route.whole is None else together(flown, *_over_all(plan, ends))


def _drawn_states(leg: Leg, draws: Draws) -> dict[str, Vector]:
    """The drawn states, the undisturbed flight first."""
    start = np.zeros(1)
    return {
        name: with_first(float(leg.answer.states[name](start)[0]), values, draws.runs)
        for name, values in draws.initial_state.items()
    }


def _after(before: Leg, leg: Leg, ends: Ends, flown: Flown) -> Begin:
    """How a leg begins after the one before."""
    with np.errstate(all="ignore"):
        states = start_after(leg.link, before.problem, ends.final, ends.parameters)
    shape = flown.lost.shape
    return Begin(
        {name: np.array(np.broadcast_to(value, shape), np.float64) for name, value in states.items()},
        ends.given,
        flown.lost,
    )


def _over_all(plan: Plan, ends: Sequence[Ends]) -> tuple[Vector | float, list[Missed]]:
    """The cost, with a peak, and the misses of limits that count over all legs."""
    whole = plan.route.whole
    assert whole is not None
    sums = [
        sum((end.integrals[item.name] for end in ends if item.name in end.integrals), start=np.zeros(1))
        for item in whole.totals
    ]
    flown = {name: value for end in ends for name, value in end.parameters.items()}
    parameters = _parameters(plan.spec, whole.parameters, flown)
    scope = whole.ends_scope(ends[0].initial, ends[-1].final, (parameters, ends[-1].parameters), NUMPY, sums)
    terminal, peaks = whole.terminal_cost, [end.peak for end in ends if end.peak is not None]
    cost = 0.0 if terminal is None else terminal.evaluate(scope, NUMPY.functions)
    missed = []
    for limit in (wish.limit for wish in plan.over_all):
        values = evaluated(limit.expression, scope, ends[-1].final[0][0].shape)
        scale = scale_of_limit(limit, abs(float(values[0])))
        missed.append(Missed(limit.pointer, limit.name, scale, limit.excess(values)))
    return cost + (np.max(peaks, axis=0) if peaks else 0.0), missed


def _parameters(spec: ProblemSpec, fixed: Mapping[str, float], flown: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of the common model: those that were ``flown`` (P,), and what follows from them."""
    table = spec.model.parameters
    unknown = {name: flown[name] for name in table if name in flown and np.ndim(flown[name])}
    found = {**fixed, **unknown}
    for name in spec.model.depending_on([*unknown]):
        found[name] = parse(table[name]).evaluate(found, NUMPY.functions)
    return found
