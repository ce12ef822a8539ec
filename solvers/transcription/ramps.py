"""Rated controls of the spline wavelet method: straight lines between points, their slopes unknowns too.

    rated control u_i: values at the K + 1 points      rate u_i': one value between two points, K

tied by  u_i(k + 1) - u_i(k) - h_k (tf - t0) u_i'(k) = 0  with the normalised width h_k. The control is
exactly the integral of its rate, so that bounds on both hold between the points too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.symbolic import CASADI
from solvers.trajectory import Trajectory
from solvers.transcription.assembly import Assembly, columns
from solvers.transcription.builder import ProgramBuilder, fixed
from solvers.transcription.nodes import Instants, NodeSymbols

Vector = NDArray[np.float64]


def allocate_ramps(this: Assembly, points: Vector) -> None:
    """Append the blocks ``ramps`` and ``rates`` to the program, started from the guess."""
    problem, count = this.problem, len(this.problem.rated)
    rates = rate_indices(this)
    first = len(problem.states) - count
    middles = (points[1:] + points[:-1]) / 2.0
    this.builder.unknowns(
        "ramps",
        (count, points.size),
        scale=this.scaling.states[first:],
        initial=lambda this: this.start.states_at(points)[first:],
        bounds=lambda this: columns(this.problem.state_bounds[first:]),
    )
    this.builder.unknowns(
        "rates",
        (count, middles.size),
        scale=this.scaling.controls[rates],
        initial=lambda this: this.start.controls_at(middles)[rates],
        bounds=lambda this: columns([this.problem.control_bounds[j] for j in rates]),
    )


def rate_indices(this: Assembly) -> list[int]:
    """For each rated control the place of its rate among the controls."""
    return [this.problem.controls.index(f"{name}_dot") for name in this.problem.rated]


def rate_rows(builder: ProgramBuilder, intervals: NDArray[np.intp]) -> list[sparse.csr_array]:
    """Rows of the rates between the points, for these indices of intervals."""
    return [
        builder.single_rows(np.arange(block.start, block.stop)[intervals])
        for block in builder.blocks["rates"]
    ]


def constrain_ramps(this: Assembly, points: Vector, middles: Instants) -> None:
    """Tie every rated control to its rate; ``middles``: the instants between the points."""
    if not this.problem.rated:
        return
    count, intervals = len(this.problem.rated), points.size - 1
    symbols = NodeSymbols(this.problem, this.per_tau)
    rates = this.problem.dynamics.rate(symbols.scope, CASADI)[-count:]
    places = this.apply(symbols.function("ramps", [symbols.duration * rate for rate in rates]), middles)
    this.builder.places["ramps"] = places
    steps = sparse.eye_array(intervals, points.size, k=1) - sparse.eye_array(intervals, points.size)
    rows = [this.builder.rows_of(block, sparse.csr_array(steps)) for block in this.builder.blocks["ramps"]]
    order = np.arange(count * intervals).reshape(count, intervals).T.ravel()
    this.builder.constrain(
        fixed(0.0, 0.0),
        scale=np.tile(this.scaling.states[-count:], intervals),
        linear=sparse.csr_array(sparse.vstack(rows, format="csr")[order]),
        places=places,
        scatter=-sparse.kron(sparse.diags_array(np.diff(points)), sparse.eye_array(count), format="csr"),
    )


def ramp_costates(this: Assembly, points: Vector, trajectory: Trajectory, row_multipliers: Vector) -> Vector:
    """Costates of the rated controls at the nodes, (r, K): lambda_k = (B' mu)_k / h_k amid the points."""
    count = len(this.problem.rated)
    if not count:
        return np.zeros((0, trajectory.nodes.size))
    adjoint = this.builder.adjoint(this.builder.places["ramps"], row_multipliers) * this.scaling.objective
    values = adjoint.reshape(-1, count).T / np.diff(points)
    middles = (points[1:] + points[:-1]) / 2.0
    inside = np.array([np.interp(trajectory.nodes, middles, row) for row in values])
    # The ends lie half an interval outside.
    for node, (near, far) in ((0, (0, 1)), (-1, (-1, -2))):
        slope = (values[:, near] - values[:, far]) / (middles[near] - middles[far])
        inside[:, node] = values[:, near] + slope * (trajectory.nodes[node] - middles[near])
    return inside
