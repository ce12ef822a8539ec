"""The objective of several plants under one command: that of the first, the mean, or the worst of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from solvers.expressions import Expression, combined, named, parse, product, total
from solvers.formulation.plants import PlantPart
from solvers.formulation.quantities import FREE, Constraint, DesignParameter, Integral
from solvers.problem import OptimalControlProblem

LEVEL = "level@"
"""The unknown that is at least as large as the objective of every plant."""


def same_objective(parts: Sequence[PlantPart]) -> bool:
    """Whether the costs of all plants are one and the same expression."""
    problems = [part.problem for part in parts]
    costs = [own.terminal_cost for own in problems], [own.running_cost for own in problems]
    return all(len({item and item.text for item in own}) == 1 for own in costs)


def averaged(whole: OptimalControlProblem, parts: Sequence[PlantPart]) -> OptimalControlProblem:
    """The problem of all plants with the mean of their objectives."""
    return replace(
        whole,
        terminal_cost=mean([part.problem.terminal_cost for part in parts]),
        running_cost=mean([part.problem.running_cost for part in parts]),
    )


def mean(costs: Sequence[Expression | None]) -> Expression | None:
    """The mean of costs, where None costs nothing; None where nothing does."""
    found = [item for item in costs if item is not None]
    return product(parse(1.0 / len(costs)), total(found)) if found else None


def with_level(whole: OptimalControlProblem, parts: Sequence[PlantPart]) -> OptimalControlProblem:
    """The problem of all plants with integrals for their running costs, and the level above objectives."""
    integrals = [
        Integral(_cost(part.name), "/problem/objective/running", part.problem.running_cost)
        for part in parts
        if part.problem.running_cost is not None
    ]
    return replace(
        whole,
        running_cost=None,
        integrals=(*whole.integrals, *integrals),
        design=(*whole.design, DesignParameter(LEVEL, FREE, 0.0)),
    )


def with_ends(whole: OptimalControlProblem, parts: Sequence[PlantPart]) -> OptimalControlProblem:
    """The problem of one of several phases with an unknown that is at least the terminal cost of each plant.

    Its costs at both ends of the phase, its peak too, add up over the phases (``end@<plant>``).
    """
    limits, unknowns = [], []
    for part in parts:
        cost, name = part.problem.terminal_cost, _end(part.name)
        if cost is not None:
            value = combined("-", cost, named(name))
            limits.append(Constraint(name, f"/problem/objective/{name}", value, (-np.inf, 0.0)))
            unknowns.append(DesignParameter(name, FREE, 0.0))
    return replace(
        whole,
        terminal_cost=None,
        boundary=(*whole.boundary, *limits),
        design=(*whole.design, *unknowns),
    )


def costs_of(plant: str, wholes: Sequence[OptimalControlProblem]) -> list[str]:
    """The names under which costs of a plant add up over one or several problems of all plants."""
    known = {item.name for whole in wholes for item in whole.integrals}
    known |= {item.name for whole in wholes for item in whole.design}
    return [name for name in (_cost(plant), _end(plant)) if name in known]


def below_level(name: str, terminal: Expression | None, added_up: Sequence[str]) -> Constraint:
    """The objective of a plant, its terminal cost and what is ``added_up``, kept below the level."""
    terms = [*([] if terminal is None else [terminal]), *map(named, added_up)]
    value = combined("-", total(terms), named(LEVEL))
    return Constraint(f"objective@{name}", "/problem/objective", value, (-np.inf, 0.0))


def _end(name: str) -> str:
    return f"end@{name}"


def _cost(name: str) -> str:
    return f"cost@{name}"
