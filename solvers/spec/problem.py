"""The ``problem`` object of a document: model, ends, bounds, constraints, objective, guess."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from solvers.data_table import DataTable
from solvers.spec.attitude import TargetQuaternion
from solvers.spec.base import SpecModel
from solvers.spec.data import DataTableSpec
from solvers.spec.faults import refuse
from solvers.spec.fields import (
    Bound,
    BoundaryExpression,
    ExpressionIn,
    PathExpression,
    Text,
    Unsupported,
    Window,
    at_most,
)
from solvers.spec.histories import HistoryTable, ResultNodes, TimeList
from solvers.spec.models import FirstOrderModel, MechanicalModel, SubmittedModel, written_out
from solvers.spec.scenarios import Scenarios
from solvers.spec.tables import MAX_UNIT, BoundTable, UnitTable
from solvers.spec.values import FREE, BoundValue, Interval, Value, bound_interval, evaluate_constant

Name = Annotated[str, Text(200)]
OutputName = Annotated[str, Text()]
Constant = Annotated[Value, ExpressionIn("constant")]
Ends = Annotated[dict[str, BoundValue], BoundTable("state", star=True)]
History = list[Value] | dict[str, list[Value]]


def _whole_span() -> list[Value]:
    return [0, 1]


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


class ProblemSpec(SpecModel):
    """An optimal-control problem as submitted: every value is still a number or an expression."""

    submitted_model: SubmittedModel = Field(alias="model", discriminator="kind")
    """The equations of motion."""
    initial_time: Bound = 0
    """Initial time t0."""
    final_time: Bound
    """Final time tf; ``[lower, upper]`` where it is free."""
    initial_state: Ends
    """State -> bound at t0, for every state; ``null`` is free, ``"*"`` stands for all that are not named."""
    final_state: Ends = Field(default_factory=dict)
    """State -> bound at tf; states that are not named are free."""
    final_attitude: Annotated[list[Value], TargetQuaternion()] | None = None
    """Quaternion q1, q2, q3, q4 (scalar part last) at tf, with either sign, for models with these states."""
    bounds: Annotated[dict[str, BoundValue], BoundTable("state or control")] = Field(default_factory=dict)
    """State or control -> bound along the trajectory."""
    path_constraints: Annotated[list[PathConstraint], AtMost] = Field(default_factory=list)
    """Constraints along the trajectory."""
    boundary_constraints: Annotated[list[BoundaryConstraint], AtMost] = Field(default_factory=list)
    """Constraints on both ends together."""
    objective: Objective
    """What is minimised."""
    guess: Guess = Guess()
    """Where the search starts."""
    units: Annotated[dict[str, str], UnitTable()] = Field(default_factory=dict)
    """Name -> label of its unit."""
    control_rates: Annotated[dict[str, BoundValue], BoundTable("control")] = Field(default_factory=dict)
    """Control -> bound of its rate <control>_dot; the control becomes a state, continuous in time."""
    initial_control: Annotated[dict[str, BoundValue], BoundTable("control")] = Field(default_factory=dict)
    """Control -> bound at t0."""
    final_control: Annotated[dict[str, BoundValue], BoundTable("control")] = Field(default_factory=dict)
    """Control -> bound at tf."""
    integrals: Annotated[list[Integral], at_most(200, "integrals")] = Field(default_factory=list)
    """Integrals over time, with bounds."""
    design: dict[str, DesignSpec] = Field(default_factory=dict)
    """Parameter of the model -> its bounds; it is optimised too."""
    outputs: Annotated[list[NamedOutput], at_most(200, "outputs")] = Field(default_factory=list)
    """Expressions that are sampled and drawn with states and controls."""
    data: dict[str, DataTableSpec] = Field(default_factory=dict)
    """Name -> points of a curve; expressions along the trajectory call it, as in ``Td(t)``."""
    scenarios: Scenarios | None = None
    """One command for several plants."""
    phases: Annotated[None, Unsupported("phases are")] = None
    """Several problems in sequence; not in this version."""
    links: Annotated[None, Unsupported("links between phases are")] = None
    """How phases are joined; not in this version."""

    @cached_property
    def model(self) -> MechanicalModel | FirstOrderModel:
        """The equations of motion, those of a library or modal model written out."""
        return written_out(self.submitted_model)

    def tables(self) -> dict[str, DataTable]:
        """Return the data tables with their numbers."""
        values = self.model.parameter_values()
        return {name: item.table(values) for name, item in self.data.items()}


def initial_intervals(problem: ProblemSpec) -> dict[str, Interval]:
    """Return ``(lower, upper)`` at t0 for every state, infinite where free."""
    return _intervals(problem, problem.initial_state)


def final_intervals(problem: ProblemSpec) -> dict[str, Interval]:
    """Return ``(lower, upper)`` at tf for every state, infinite where free."""
    return _intervals(problem, problem.final_state)


def path_intervals(problem: ProblemSpec) -> dict[str, Interval]:
    """Return ``(lower, upper)`` along the trajectory for every state and control, infinite where free."""
    values = problem.model.parameter_values()
    names = problem.model.states + problem.model.controls
    return {name: bound_interval(problem.bounds.get(name), values) for name in names}


def _intervals(problem: ProblemSpec, ends: dict[str, BoundValue]) -> dict[str, Interval]:
    values = problem.model.parameter_values()
    star = bound_interval(ends["*"], values) if "*" in ends else FREE
    return {
        state: bound_interval(ends[state], values) if state in ends else star
        for state in problem.model.states
    }
