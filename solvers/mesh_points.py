"""Where the points of a fixed mesh are: equal pieces, and the corners of data tables over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solvers.bases.graded import GradedKnots
from solvers.formulation.time_knots import mesh_corners, refined_at, with_corners, with_moments
from solvers.problem import OptimalControlProblem

Vector = NDArray[np.float64]

# The smallest number of nodes of a segment that a corner has cut.
_FEWEST_NODES = 6


def spline_mesh(problem: OptimalControlProblem, length: int, level: int) -> GradedKnots:
    """Uniform knots, graded towards the corners of data tables over time."""
    return refined_at(GradedKnots.uniform(length, level), mesh_corners(problem))


def interval_mesh(problem: OptimalControlProblem, intervals: int) -> Vector:
    """The ends of equal intervals, and the corners of data tables over time."""
    knots = with_corners(np.linspace(0.0, 1.0, intervals + 1), mesh_corners(problem))
    return with_moments(knots, mesh_corners(problem, jumps_only=True))


def interval_corners(problem: OptimalControlProblem) -> Vector:
    """The points of :func:`interval_mesh` that are there for the corners."""
    return with_moments(mesh_corners(problem), mesh_corners(problem, jumps_only=True))


def gauss_mesh(problem: OptimalControlProblem, nodes: int, segments: int) -> tuple[Vector, tuple[int, ...]]:
    """The breaks of equal segments and at the corners of data tables over time; the nodes of each segment.

    Where corners cut a segment, each piece has its share of the nodes, but no fewer than 6.
    """
    even = np.linspace(0.0, 1.0, segments + 1)
    breaks = with_corners(even, mesh_corners(problem))
    if breaks.size == even.size and np.array_equal(breaks, even):
        return even, (nodes,) * segments
    shares = np.ceil(nodes * segments * np.diff(breaks) - 1e-9).astype(int)
    return breaks, tuple(np.clip(shares, min(nodes, _FEWEST_NODES), nodes).tolist())
