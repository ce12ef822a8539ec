"""Which expression of the document has no finite value, when a solve stumbles over one.

What has a value but no slope there is found by :mod:`solvers.slope_fault`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.errors import Fault
from solvers.expressions import Expression, parse
from solvers.formulation.data_table import DataTable, calls
from solvers.formulation.time_knots import along
from solvers.models import Formula
from solvers.problem import OptimalControlProblem
from solvers.spec import MechanicalModel, ProblemSpec
from solvers.trajectory import Trajectory
from solvers.verification.violations import dense

Vector = NDArray[np.float64]

Where = Literal["nodes", "slopes", "tables", "ends"]
"""Whether any expression has no finite value at a node, or no finite slope; one that calls tables no value,
be it between the nodes; or comes near to the end of a table without values, where searches do not get on."""

# So near to an end of a table, as a part of its span.
_NEAR = 0.01
# Whether a value is at a corner is told by so many digits of what is larger than 1, else so many decimals.
_DIGITS = 14


def find_evaluation_fault(
    spec: ProblemSpec, problem: OptimalControlProblem, trajectory: Trajectory, where: Where = "nodes"
) -> Fault | None:
    """The first expression that is at fault on this trajectory, or None."""
    tau = trajectory.nodes if where == "nodes" else dense(trajectory.breakpoints)
    if where == "ends":
        problem = replace(problem, definitions=_shortened(problem))
    for place in places_of(spec, problem, trajectory, tau):
        expression = place.expression
        if where != "nodes" and not expression.called:
            continue
        with np.errstate(all="ignore"):
            values = np.broadcast_to(expression.evaluate(place.scope, NUMPY.functions), place.times.shape)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            what = "has no finite value" if where != "ends" else "comes to the end of what it is made of"
            more = "".join(_end_of(name, spec.tables()[name]) for name in sorted(expression.called))
            if place.names and not more:
                more = f"; what helps is bounds that keep {' and '.join(place.names)} where it has one"
            return Fault(place.pointer, f"'{expression.text}' {what} at {place.told(int(bad[0]))}{more}")
    return None


@dataclass(frozen=True)
class Place:
    """An expression of the document, and the values of all that it may name at its K ``times``.

    ``given``: the names of fixed numbers; ``ends``: whether it is said of the ends only.
    """

    pointer: str
    expression: Expression
    scope: Mapping[str, Any]
    times: Vector
    given: frozenset[str]
    ends: bool = False

    @property
    def names(self) -> list[str]:
        """What it names that may change along the way."""
        return sorted(self.expression.names - self.expression.called - self.given)

    @property
    def values(self) -> Vector:
        """Those of its names, (len(names), K), without the roundings with which they are read from nodes."""
        rows = [np.broadcast_to(self.scope[name], self.times.shape) for name in self.names]
        values = np.array(rows, np.float64).reshape(-1, self.times.size)
        scale = np.maximum(1.0, np.abs(values).max(axis=1, keepdims=True))
        return np.asarray(np.round(values / scale, _DIGITS) * scale, np.float64)

    def told(self, index: int) -> str:
        """The time, and the values of what is named, at one of the times."""
        pairs = zip(self.names, self.values[:, index], strict=True)
        values = ", ".join(f"{name} = {value:.6g}" for name, value in pairs)
        return f"t = {self.times[index]:.6g}" + (f" ({values})" if values else "")


def places_of(
    spec: ProblemSpec, problem: OptimalControlProblem, trajectory: Trajectory, tau: Vector
) -> Iterator[Place]:
    """Every expression of the trajectory at normalised times (K,), then those of the ends."""
    parameters = problem.parameters_of(trajectory)
    given = frozenset(parameters) - {item.name for item in problem.design}

    def at(tau: Vector) -> tuple[Vector, Vector, Vector]:
        return trajectory.states_at(tau), trajectory.controls_at(tau), trajectory.time(tau)

    along = at(tau)
    scope = problem.scope(*along, parameters, NUMPY)
    for pointer, expression in _along_the_trajectory(spec):
        yield Place(pointer, expression, scope, along[-1], given)
    first, last = at(np.zeros(1)), at(np.ones(1))
    with np.errstate(all="ignore"):
        unknown = [np.zeros(1)] * len(problem.integrals)
        ends = problem.ends_scope(first, last, parameters, NUMPY, unknown)
    integrals = {item.name for item in problem.integrals}
    for pointer, expression in _at_the_ends(spec):
        if expression.names <= ends.keys() - integrals:
            yield Place(pointer, expression, ends, last[-1], given, ends=True)


def _shortened(problem: OptimalControlProblem) -> dict[str, Formula]:
    """The definitions with shorter tables in place of those without values outside.

    Not of those over time: a flight may well end with them.
    """
    over_time = {name for item in along(problem) for name, in_time in calls(item) if in_time}
    found = dict(problem.definitions)
    for name, item in found.items():
        if isinstance(item, DataTable) and item.outside == "error" and name not in over_time:
            x = np.array(item.x)
            middle = (x[0] + x[-1]) / 2.0
            found[name] = replace(item, x=tuple(middle + (1.0 - 2.0 * _NEAR) * (x - middle)))
    return found


def _end_of(name: str, table: DataTable) -> str:
    """What a table covers that has no values outside."""
    if table.outside != "error":
        return ""
    return f"; the table '{name}' goes from {table.x[0]:g} to {table.x[-1]:g}"


def _along_the_trajectory(spec: ProblemSpec) -> Iterator[tuple[str, Expression]]:
    """Every expression of states, controls and t with its pointer."""
    model = spec.model
    base = "/problem/model"
    for name, entry in model.definitions.items():
        yield f"{base}/definitions/{name}", parse(entry)
    if isinstance(model, MechanicalModel):
        for place, entry in model.entries():
            yield base + "".join(f"/{part}" for part in place), parse(entry)
    else:
        for name, entry in model.dynamics.items():
            yield f"{base}/dynamics/{name}", parse(entry)
    for index, constraint in enumerate(spec.path_constraints):
        yield f"/problem/path_constraints/{index}/expression", parse(constraint.expression)
    for index, integral in enumerate(spec.integrals):
        yield f"/problem/integrals/{index}/expression", parse(integral.expression)
    for key in ("running", "maximum"):
        cost = getattr(spec.objective, key)
        if cost is not None:
            yield f"/problem/objective/{key}", parse(cost)


def _at_the_ends(spec: ProblemSpec) -> Iterator[tuple[str, Expression]]:
    """Every expression of both ends with its pointer."""
    for index, constraint in enumerate(spec.boundary_constraints):
        yield f"/problem/boundary_constraints/{index}/expression", parse(constraint.expression)
    if spec.objective.terminal is not None:
        yield "/problem/objective/terminal", parse(spec.objective.terminal)
