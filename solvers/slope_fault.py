"""Which expression of the document has no finite slope or curvature, where its value is finite.

Optimizers ask for first and second derivatives too: sqrt(x) has a value at x = 0, but no slope, and x^1.5 no
curvature. They are taken here exactly as the optimizer has them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import casadi as ca
import numpy as np

from solvers.errors import Fault
from solvers.formulation.data_table import DataTable
from solvers.problem import OptimalControlProblem
from solvers.spec import ProblemSpec
from solvers.symbolic import FUNCTIONS, look_up
from solvers.trajectory import Trajectory
from solvers.verification.evaluation_fault import Place, places_of

_NO_NODE_THERE = ", or the method gpm, which has no node at the ends"


def find_slope_fault(
    spec: ProblemSpec, problem: OptimalControlProblem, trajectory: Trajectory
) -> Fault | None:
    """The first expression at fault at the nodes and ends of this trajectory, or None."""
    tables = spec.tables()
    for place in places_of(spec, problem, trajectory, trajectory.nodes):
        for kind, name, index in _without(place, tables):
            what = f"'{place.expression.text}' has a value, but no finite {kind} over {name}"
            at_end = not place.ends and place.times[index] in (trajectory.t0, trajectory.tf)
            advice = (
                f"what helps is bounds and ends that keep {name} off that value by a little, or an expression"
                f" that is smooth there{_NO_NODE_THERE if at_end else ''}"
            )
            return Fault(place.pointer, f"{what} at {place.told(index)}; {advice}")
    return None


def _without(place: Place, tables: Mapping[str, DataTable]) -> Iterator[tuple[str, str, int]]:
    """Whether the slope or the curvature is not finite, over what, and where."""
    names = place.names
    if not names:
        return
    unknown = ca.SX.sym("names", len(names))
    scope = {
        **{name: place.scope[name] for name in place.expression.names & place.given},
        **{name: partial(look_up, tables[name]) for name in place.expression.called},
        **dict(zip(names, ca.vertsplit(unknown), strict=True)),
    }
    curvature, slope = ca.hessian(ca.SX(place.expression.evaluate(scope, FUNCTIONS)), unknown)
    derivatives = ca.Function("derivatives", [unknown], [slope, ca.sum2(ca.fabs(curvature))])
    found = derivatives(place.values)
    for kind, rows in zip(("slope", "curvature"), found, strict=True):
        for index, row in np.argwhere(~np.isfinite(np.array(rows)).T):
            yield kind, names[row], int(index)
