"""The ``problem`` object of a document: model, ends, bounds, constraints, objective, guess."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated

from pydantic import Field

from solvers.formulation.data_table import DataTable
from solvers.spec.attitude import TargetQuaternion
from solvers.spec.base import SpecModel
from solvers.spec.data import DataTableSpec
from solvers.spec.fields import Bound
from solvers.spec.models import FirstOrderModel, MechanicalModel, SubmittedModel, written_out
from solvers.spec.parts import (
    BoundaryConstraints,
    Bounds,
    DesignSpec,
    Ends,
    Guess,
    Integrals,
    Objective,
    OfControls,
    Outputs,
    PathConstraints,
)
from solvers.spec.phases import LinkList, LinkSpec, PhaseList, PhaseSpec
from solvers.spec.scenarios import Scenarios
from solvers.spec.tables import UnitTable
from solvers.spec.values import FREE, BoundValue, Interval, Value, bound_interval


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
    bounds: Bounds = Field(default_factory=dict)
    """State or control -> bound along the trajectory."""
    path_constraints: PathConstraints = Field(default_factory=list)
    """Constraints along the trajectory."""
    boundary_constraints: BoundaryConstraints = Field(default_factory=list)
    """Constraints on both ends together."""
    objective: Objective
    """What is minimised."""
    guess: Guess = Guess()
    """Where the search starts."""
    units: Annotated[dict[str, str], UnitTable()] = Field(default_factory=dict)
    """Name -> label of its unit."""
    control_rates: OfControls = Field(default_factory=dict)
    """Control -> bound of its rate <control>_dot; the control becomes a state, continuous in time."""
    initial_control: OfControls = Field(default_factory=dict)
    """Control -> bound at t0."""
    final_control: OfControls = Field(default_factory=dict)
    """Control -> bound at tf."""
    integrals: Integrals = Field(default_factory=list)
    """Integrals over time, with bounds."""
    design: dict[str, DesignSpec] = Field(default_factory=dict)
    """Parameter of the model -> its bounds; it is optimised too."""
    outputs: Outputs = Field(default_factory=list)
    """Expressions that are sampled and drawn with states and controls."""
    data: dict[str, DataTableSpec] = Field(default_factory=dict)
    """Name -> points of a curve; expressions along the trajectory call it, as in ``Td(t)``."""
    scenarios: Scenarios | None = None
    """One command for several plants."""
    phases: Annotated[list[PhaseSpec], PhaseList()] = Field(default_factory=list)
    """Problems that are flown one after the other; what stands beside them is common to all."""
    links: Annotated[list[LinkSpec], LinkList()] = Field(default_factory=list)
    """Where a phase does not begin as the one before ends."""

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
