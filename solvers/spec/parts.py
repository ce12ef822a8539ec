"""The parts of a problem: constraints, integrals, outputs, design parameters, objective, guess."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from solvers.spec.base import SpecModel
from solvers.spec.faults import refuse
from solvers.spec.fields import (
    Bound,
    BoundaryExpression,
    ConstantCheck,
    PathExpression,
    Text,
    Window,
    at_most,
)
from solvers.spec.histories import HistoryTable, ResultNodes, TimeList
from solvers.spec.tables import MAX_UNIT, BoundTable
from solvers.spec.values import BoundValue, Interval, Value, evaluate_constant

Name = Annotated[str, Text(200)]
OutputName = Annotated[str, Text()]
Constant = Annotated[Value, ConstantCheck()]
Ends = Annotated[dict[str, BoundValue], BoundTable("state", star=True)]
History = list[Value] | dict[str, list[Value]]


def _whole_span() -> list[Value]:
    return [0, 1]


Bounds = Annotated[dict[str, BoundValue], BoundTable("state or control")]
OfControls = Annotated[dict[str, BoundValue], BoundTable("control")]
AtMost = at_most(1000, "constraints")


class PathConstraint(SpecModel):
    """An expression that stays within bounds along the trajectory, or a part of it."""

    name: Name = ""
    """A name for the result."""
    expression: PathExpression
    """Expression in states, controls, parameters and t."""
    bounds: Bound
    """What its value must be or lie between."""
    during: Annotated[list[Value], Window()] = Field(default_factory=_whole_span)
    """The part of the time span in which it holds: start and end, counted from 0 at t0 to 1 at tf."""

    def window(self, parameters: dict[str, float]) -> Interval:
        """Return ``during`` as numbers."""
        start, stop = (evaluate_constant(value, parameters) for value in self.during)
        return start, stop


class BoundaryConstraint(SpecModel):
    """An expression of both ends that has given bounds."""

    name: Name = ""
    """A name for the result."""
    expression: BoundaryExpression
    """Expression in <state>_0, <state>_f, likewise of controls, <output>_f, integrals, parameters, t0, tf."""
    bounds: Bound
    """What its value must be or lie between."""

    def window(self, parameters: dict[str, float]) -> Interval:
        """Return the whole span: the ends belong to it."""
        return 0.0, 1.0


class Integral(SpecModel):
    """The integral of an expression from t0 to tf; boundary constraints and terminal cost may name it."""

    name: OutputName
    """Its name in boundary constraints, in the terminal cost and in the result."""
    expression: PathExpression
    """Expression in states, controls, accelerations, parameters, definitions and t."""
    bounds: Bound | None = None
    """What its value must be or lie between; null is free."""


class DesignSpec(SpecModel):
    """A parameter of the model that is optimised too."""

    bounds: Bound
    """What its value must lie between."""
    guess: Constant | None = None
    """Where it starts; the model's own value where that is within the bounds."""


class NamedOutput(SpecModel):
    """A quantity along the trajectory that the result shows."""

    name: OutputName
    """Its name in the result; ``<name>_f`` is its value at the end of the flight."""
    expression: PathExpression
    """Expression in states, controls, accelerations, parameters, definitions and t."""
    units: Annotated[str, Text(MAX_UNIT)] = ""
    """Label of its unit."""


class Objective(SpecModel):
    """What is minimised: terminal cost + integral of the running cost (Bolza) + peak."""

    terminal: BoundaryExpression | None = None
    """Terminal cost (Mayer), an expression of the ends such as ``tf``."""
    running: PathExpression | None = None
    """Running cost (Lagrange), integrated from t0 to tf."""
    maximum: PathExpression | None = None
    """Peak cost: the largest value along the trajectory."""

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.terminal is None and self.running is None and self.maximum is None:
            raise refuse("at least one of 'terminal', 'running' and 'maximum' is needed")
        return self


class Guess(SpecModel):
    """Where the search starts; what is not given is taken from ends and bounds."""

    final_time: Constant | None = None
    """Final time."""
    times: Annotated[list[Value], TimeList()] | None = None
    """Times of all lists of ``states`` and ``controls``; equally spaced without it."""
    states: Annotated[dict[str, History], HistoryTable("state")] = Field(default_factory=dict)
    """State -> values over time."""
    controls: Annotated[dict[str, History], HistoryTable("control")] = Field(default_factory=dict)
    """Control -> values over time."""
    from_result: Annotated[dict[str, Any], ResultNodes()] | None = None
    """The ``nodes`` of a result, stretched over the time span; the other keys go before it."""

    def history(
        self, name: str, parameters: dict[str, float]
    ) -> tuple[list[float] | None, list[float]] | None:
        """Return ``(times, values)`` given for a state or control, or None if nothing is.

        ``times`` is None where the values are equally spaced from initial to final time.
        """
        given = self.states.get(name, self.controls.get(name))
        if given is None:
            return None
        times, values = self.times, given
        if isinstance(given, dict):
            times, values = given["times"], given["values"]
        numbers = [evaluate_constant(value, parameters) for value in values]
        return None if times is None else [evaluate_constant(time, parameters) for time in times], numbers


PathConstraints = Annotated[list[PathConstraint], AtMost]
BoundaryConstraints = Annotated[list[BoundaryConstraint], AtMost]
Integrals = Annotated[list[Integral], at_most(200, "integrals")]
Outputs = Annotated[list[NamedOutput], at_most(200, "outputs")]
