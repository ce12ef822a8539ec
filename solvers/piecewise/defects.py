"""What holds along a horizon: Hermite-Simpson's equations with their running cost, and path constraints.

On an interval of a part of n intervals, with F = d f for the length d of that part, at left end, middle and
right end:

    x_m - (x_l + x_r) / 2 - (F_l - F_r) / (8 n) = 0,      x_r - x_l - (F_l + 4 F_m + F_r) / (6 n) = 0.

Source: as `solvers.transcription.hermite_simpson`.
"""

from __future__ import annotations

from typing import Literal

import casadi as ca
import numpy as np
from scipy import sparse

from solvers.piecewise.layout import Layout
from solvers.piecewise.mesh import Indices, Vector
from solvers.start.scaling import magnitude
from solvers.symbolic import CASADI
from solvers.transcription.builder import Places, fixed

# Path constraints, like bounds, wait until the start is behind.
_SETTLING_INSTANTS = 4
_FREE = (-np.inf, np.inf)


def add_dynamics(layout: Layout) -> None:
    """Hermite's middle and Simpson's end of every interval; Simpson's rule for the running cost."""
    builder, mesh, n = layout.builder, layout.mesh, layout.scales.states.size
    left = mesh.left_instants
    ones = np.ones(left.size)
    # Where an interval's three places are: those of the second part come one later, after the boundary.
    left_place = left + (left >= mesh.boundary)
    widths = np.where(left < mesh.boundary, 1.0 / mesh.nodes, 1.0 / max(1, mesh.rest))
    total = mesh.local.size
    simpson = _triples(left_place, [-1 / 6, -4 / 6, -1 / 6], widths, total)
    states = sparse.vstack(
        [
            _triples(left, [-0.5, 1.0, -0.5], ones, mesh.instants),
            _triples(left, [-1.0, 0.0, 1.0], ones, mesh.instants),
        ],
        format="csr",
    )
    rates = sparse.vstack([_triples(left_place, [-1 / 8, 0.0, 1 / 8], widths, total), simpson], format="csr")
    linear = [builder.rows_of(block, sparse.csr_array(states)) for block in builder.blocks["states"]]
    chosen = [sparse.kron(rates, sparse.csr_array(np.eye(n)[[index]]), format="csr") for index in range(n)]
    builder.constrain(
        fixed(0.0, 0.0),
        scale=np.repeat(layout.scales.states, 2 * left.size),
        linear=sparse.csr_array(sparse.vstack(linear, format="csr")),
        places=_applied(layout, "rate"),
        scatter=sparse.csr_array(sparse.vstack(chosen, format="csr")),
    )
    if layout.model.problem.running_cost is not None:
        builder.cost(_applied(layout, "cost"), -np.asarray(simpson.sum(axis=0), np.float64))


def add_path(layout: Layout) -> None:
    """Path constraints at every place but the first ones."""
    path = layout.model.problem.path
    if not path:
        return
    instants, _ = layout.mesh.places
    waits = instants < _SETTLING_INSTANTS
    intervals = np.array([item.interval for item in path], np.float64)
    both = np.where(waits[:, None, None], np.array(_FREE), intervals[None, :, :]).reshape(-1, 2)
    layout.builder.constrain(
        lambda _: (both[:, 0], both[:, 1]),
        scale=np.tile([magnitude(item.interval) for item in path], instants.size),
        places=_applied(layout, "path"),
    )


def _applied(layout: Layout, name: Literal["rate", "cost", "path"]) -> Places:
    """At all places the rates or the running cost, times the length of the part, or the path constraints."""
    model, problem = layout.model, layout.model.problem
    n, m = len(model.driven), len(problem.controls)
    z = ca.SX.sym("z", n + m + 2)
    parts = ca.vertsplit(z)
    before, length = parts[-2:]
    p = ca.SX.sym("p", model.numbers if model.known_times else 2)
    numbers = ca.vertsplit(p) if model.known_times else [p[0] + before + p[1] * length]
    scope = model.scope(parts[:n], parts[n : n + m], numbers)
    if name == "rate":
        found = [length * rate for rate in model.driven_rate(scope)]
    elif name == "path":
        found = [item.expression.evaluate(scope, CASADI.functions) for item in problem.path]
    else:
        assert problem.running_cost is not None
        found = [length * problem.running_cost.evaluate(scope, CASADI.functions)]
    function = ca.Function(name, [z, p], [ca.vertcat(*[ca.SX(value) for value in found])])
    instants, _ = layout.mesh.places
    blocks = [*layout.rows("states", instants), *layout.rows("controls", instants), *layout.spans()]
    return layout.builder.apply(function, blocks, lambda this: this.numbers)


def _triples(left: Indices, entries: list[float], factors: Vector, columns: int) -> sparse.csr_array:
    """A row for each interval with ``entries`` times its factor at its left end, middle and right end."""
    rows = np.repeat(np.arange(left.size), 3)
    places = (left[:, None] + np.arange(3)).ravel()
    values = (factors[:, None] * np.array(entries)).ravel()
    return sparse.csr_array((values, (rows, places)), shape=(left.size, columns))
