"""Which expression of the document has no finite value, when a solve stumbles over one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from solvers.backends import NUMPY
from solvers.errors import Fault
from solvers.expressions import Expression, parse
from solvers.problem import OptimalControlProblem
from solvers.spec import MechanicalModel, ProblemSpec
from solvers.trajectory import Trajectory


def find_evaluation_fault(
    spec: ProblemSpec, problem: OptimalControlProblem, trajectory: Trajectory
) -> Fault | None:
    """The first expression that is not finite on the nodes of this trajectory, or None."""
    tau = trajectory.nodes
    times = trajectory.time(tau)
    scope = problem.scope(
        trajectory.states_at(tau),
        trajectory.controls_at(tau),
        times,
        problem.parameters_of(trajectory),
        NUMPY,
    )
    for pointer, expression in _along_the_trajectory(spec):
        with np.errstate(all="ignore"):
            values = np.broadcast_to(expression.evaluate(scope, NUMPY.functions), tau.shape)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            where = ", ".join(
                f"{name} = {float(np.broadcast_to(scope[name], tau.shape)[bad[0]]):.6g}"
                for name in sorted(expression.names - expression.called - set(problem.parameters))
            )
            detail = f"'{expression.text}' has no finite value at t = {times[bad[0]]:.6g}"
            return Fault(pointer, f"{detail} ({where})" if where else detail)
    return None


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
