"""Where a horizon is the end of the problem: boundary constraints and the terminal cost."""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy import sparse

from solvers.piecewise.layout import Layout
from solvers.start.scaling import magnitude
from solvers.symbolic import CASADI


def add_ends(layout: Layout) -> None:
    """Boundary constraints, which hold only where the horizon is the end, and the terminal cost."""
    problem, builder = layout.model.problem, layout.builder
    if not problem.at_the_ends:
        return
    function = _function(layout)
    outside = len(layout.model.exogenous)
    end, begin = np.array([layout.mesh.instants - 1]), np.array([0])
    blocks = [
        *layout.rows("states", end),
        *layout.rows("controls", begin),
        *layout.rows("controls", end),
        *[builder.rows_of(block) for block in builder.blocks["lengths"]],
    ]
    places = builder.apply(
        function,
        blocks,
        lambda this: np.concatenate([this.initial, this.numbers[:outside, -1], [this.time]])[:, None],
    )
    values, count = function.size1_out(0), len(problem.boundary)
    if count:
        builder.constrain(
            lambda this: (this.boundary[:, 0], this.boundary[:, 1]),
            scale=np.array([magnitude(item.interval) for item in problem.boundary]),
            places=places,
            scatter=sparse.csr_array(np.eye(count, values)),
        )
    if problem.terminal_cost is not None:
        builder.cost(places, np.eye(values)[-1])


def _function(layout: Layout) -> ca.Function:
    """(states at the end, controls at both, lengths; all states, exogenous at the end, time) -> values."""
    problem, model = layout.model.problem, layout.model
    n, m = len(model.driven), len(problem.controls)
    all_states = len(problem.states)
    outside = len(model.exogenous)
    z = ca.SX.sym("z", n + 2 * m + 2)
    p = ca.SX.sym("p", all_states + outside + 1)
    x, first, last, lengths = (
        ca.vertsplit(part) for part in ca.vertsplit(z, [0, n, n + m, n + 2 * m, n + 2 * m + 2])
    )
    final: list[ca.SX] = [ca.SX(0)] * all_states
    for place, index in enumerate(model.driven):
        final[index] = x[place]
    for place, index in enumerate(model.exogenous):
        final[index] = p[all_states + place]
    start = p[all_states + outside]
    scope = problem.ends_scope(
        (ca.vertsplit(p[:all_states]), first, start),
        (final, last, start + lengths[0] + lengths[1]),
        problem.parameters,
        CASADI,
    )
    values = [ca.SX(item.evaluate(scope, CASADI.functions)) for item in problem.at_the_ends]
    return ca.Function("ends", [z, p], [ca.vertcat(*values)])
