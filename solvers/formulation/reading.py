"""From the parts of a checked document to the quantities of a problem."""

from __future__ import annotations

from collections.abc import Mapping

from solvers.expressions import parse
from solvers.formulation.energy import vibration_energy
from solvers.formulation.quantities import Constraint, DesignParameter, Integral, Interval, NamedQuantity
from solvers.spec import (
    VIBRATION_ENERGY,
    BoundValue,
    DesignSpec,
    ProblemSpec,
    bound_interval,
    evaluate_constant,
    inside,
)


def constraints(spec: ProblemSpec, key: str, parameters: dict[str, float]) -> tuple[Constraint, ...]:
    """The path or boundary constraints, as ``key`` says."""
    return tuple(
        Constraint(
            item.name or f"{key}/{index}",
            f"/problem/{key}/{index}",
            parse(item.expression),
            bound_interval(item.bounds, parameters),
            item.window(parameters),
        )
        for index, item in enumerate(getattr(spec, key))
    )


def integrals(spec: ProblemSpec, parameters: dict[str, float]) -> tuple[Integral, ...]:
    """The integrals with their bounds."""
    return tuple(
        Integral(
            item.name,
            f"/problem/integrals/{index}",
            parse(item.expression),
            bound_interval(item.bounds, parameters),
        )
        for index, item in enumerate(spec.integrals)
    )


def design_parameter(name: str, item: DesignSpec, values: dict[str, float]) -> DesignParameter:
    """Start from the guess, else from the model's own value if it is allowed, else inside the bounds."""
    interval = bound_interval(item.bounds, values)
    own = values[name] if interval[0] <= values[name] <= interval[1] else inside(interval)
    guess = own if item.guess is None else evaluate_constant(item.guess, values)
    return DesignParameter(name, interval, guess)


def control_ends(
    given: Mapping[str, BoundValue], controls: tuple[str, ...], parameters: dict[str, float]
) -> tuple[Interval, ...]:
    """An interval for each control at one of the ends."""
    return tuple(bound_interval(given.get(name), parameters) for name in controls)


def outputs(spec: ProblemSpec) -> tuple[NamedQuantity, ...]:
    """The outputs of the document, then the one that a flexible model brings by itself."""
    found = [NamedQuantity(item.name, parse(item.expression), item.units) for item in spec.outputs]
    energy = vibration_energy(spec.model)
    if energy is not None:
        found.append(NamedQuantity(VIBRATION_ENERGY, energy, spec.units.get(VIBRATION_ENERGY, "")))
    return tuple(found)
