"""Which expression of the document has no finite value, when a solve stumbles over one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np

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

Where = Literal["nodes", "tables", "ends"]
"""Whether any expression has no finite value at a node; one that calls tables, be it between the nodes; or
that comes near to the end of a table that has no values beyond, where a search does not get on."""

# So near to an end of a table, as a part of its span.
_NEAR = 0.01


def find_evaluation_fault(
    spec: ProblemSpec, problem: OptimalControlProblem, trajectory: Trajectory, where: Where = "nodes"
) -> Fault | None:
    """The first expression that is at fault on this trajectory, or None."""
    tau = trajectory.nodes if where == "nodes" else dense(trajectory.breakpoints)
    if where == "ends":
        problem = replace(problem, definitions=_shortened(problem))
    times = trajectory.time(tau)
    scope = problem.scope(
        trajectory.states_at(tau),
        trajectory.controls_at(tau),
        times,
        problem.parameters_of(trajectory),
        NUMPY,
    )
    for pointer, expression in _along_the_trajectory(spec):
        if where != "nodes" and not expression.called:
            continue
        with np.errstate(all="ignore"):
            values = np.broadcast_to(expression.evaluate(scope, NUMPY.functions), tau.shape)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            names = ", ".join(
                f"{name} = {float(np.broadcast_to(scope[name], tau.shape)[bad[0]]):.6g}"
                for name in sorted(expression.names - expression.called - set(problem.parameters))
            )
            what = "has no finite value" if where != "ends" else "comes to the end of what it is made of"
            detail = f"'{expression.text}' {what} at t = {times[bad[0]]:.6g}"
            detail += "".join(_end_of(name, spec.tables()[name]) for name in sorted(expression.called))
            return Fault(pointer, f"{detail} ({names})" if names else detail)
    return None


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
