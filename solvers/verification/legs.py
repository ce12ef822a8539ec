"""An answer as it is flown: leg after leg, one for each phase, a single one where there are no phases."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from solvers.expressions import parse
from solvers.formulation.scenarios import formulate
from solvers.phases.problem import Link, Phase, PhasedProblem, begin_after
from solvers.phases.scenarios import formulate_phases
from solvers.phases.trajectory import AnyTrajectory
from solvers.problem import OptimalControlProblem
from solvers.spec import Objective, ProblemSpec
from solvers.spec.places import place_in_document
from solvers.trajectory import Trajectory
from solvers.verification.flight import whole_flight

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Leg:
    """A part of an answer that goes by one model: the whole of it where there are no phases.

    ``link``: how it begins after the leg before; ``spec``: the problem that it is by itself; ``located``: the
    place in the document of what stands at a pointer into that.
    """

    name: str
    problem: OptimalControlProblem
    answer: Trajectory
    link: Link
    spec: ProblemSpec
    located: Callable[[str], str]


@dataclass(frozen=True)
class Route:
    """The legs of one plant, in their order; ``name``: that of the plant, empty where there is one.

    ``whole``: what counts over all legs, where these are phases.
    """

    name: str
    legs: tuple[Leg, ...]
    whole: PhasedProblem | None = None


def routes(spec: ProblemSpec, answers: Sequence[AnyTrajectory]) -> Iterator[Route]:
    """The legs of each plant that has an answer, the leading one first."""
    if spec.phases:
        for flight, answer in zip(formulate_phases(spec).plants, answers, strict=False):
            problem = flight.problem
            triples = zip(problem.phases, (Link({}), *problem.links), answer.parts, strict=True)
            yield Route(flight.name, tuple(_of_phase(*triple) for triple in triples), problem)
        return
    for plant, answer in zip(formulate(spec).plants, answers, strict=False):
        place = partial(place_in_document, spec)
        (part,) = answer.parts
        yield Route(plant.name, (Leg(plant.name, plant.problem, part, Link({}), spec, place),))


def without_rates(spec: ProblemSpec) -> ProblemSpec:
    """The problem whose controls are the document's own, none is a state, and no rate of them costs."""
    rates = rates_of(spec)
    return spec.changed(
        control_rates={},
        objective=_without(spec.objective, rates),
        phases=[
            phase.changed(control_rates={}, objective=phase.objective and _without(phase.objective, rates))
            for phase in spec.phases
        ],
    )


def _without(objective: Objective, rates: frozenset[str]) -> Objective:
    return objective.changed(**dict.fromkeys(rate_costs(objective, rates)))


def rate_costs(objective: Objective, rates: frozenset[str]) -> list[str]:
    """The keys of an objective along the flight whose costs name ``rates`` of controls."""
    costs = {"running": objective.running, "maximum": objective.maximum}
    return [
        key for key, cost in costs.items() if cost is not None and not parse(cost).names.isdisjoint(rates)
    ]


def rates_of(spec: ProblemSpec) -> frozenset[str]:
    """The rates of controls that expressions may name, which no table of commands has."""
    rated = [spec.control_rates, *(phase.control_rates for phase in spec.phases)]
    return frozenset(f"{name}_dot" for names in rated for name in names)


def fly_legs(
    legs: Sequence[Leg], flown: Sequence[Trajectory], promised: Sequence[Vector]
) -> Iterator[Vector]:
    """Yield the states (n,) in which each leg ends, flown one after the other under the controls ``flown``.

    ``promised`` (n, K + 1): about where each goes at the breakpoints of its control. The first leg begins
    there, later ones as their links say. Raises FlightError where one does not come to its end.
    """
    end = np.empty(0)
    for index, (leg, states) in enumerate(zip(legs, promised, strict=True)):
        begin = states[:, 0]
        if index:
            begin = begin_after(leg.link, legs[index - 1].problem, flown[index - 1], end, leg.problem, begin)
        end = whole_flight(leg.problem, flown[index], np.column_stack([begin, states[:, 1:]]))
        yield end


def _of_phase(phase: Phase, link: Link, answer: Trajectory) -> Leg:
    return Leg(phase.name, phase.plant.problem, answer, link, phase.spec, phase.place)
