"""How the spline wavelet method has controls between its points: hat functions, quadratic splines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import BSpline

from solvers.bases.banded import solve_banded_system
from solvers.bases.legendre import composite_gauss
from solvers.formulation.quantities import Interval

Vector = NDArray[np.float64]

COST_POINTS = 3
"""Gauss points on an interval that integrate products of quadratic splines."""


def quadratic_splines(knots: Vector, tau: Vector) -> sparse.csr_array:
    """Rows of the B-splines of degree 2 on ``knots``."""
    clamped = np.concatenate([np.zeros(2), knots, np.ones(2)])
    return sparse.csr_array(BSpline.design_matrix(tau, clamped, 2))


def hat_functions(points: Vector, tau: Vector) -> sparse.csr_array:
    """Rows of linear interpolation between ``points``."""
    left = np.clip(np.searchsorted(points, tau, side="right") - 1, 0, points.size - 2)
    fraction = (tau - points[left]) / (points[left + 1] - points[left])
    rows = np.arange(tau.size)
    matrix = sparse.csr_array(
        (
            np.concatenate([1.0 - fraction, fraction]),
            (np.concatenate([rows, rows]), np.concatenate([left, left + 1])),
        ),
        shape=(tau.size, points.size),
    )
    matrix.eliminate_zeros()
    return matrix


def nearest_lines(knots: Vector, points: Vector, values: Vector, bounds: Interval) -> Vector:
    """Values at ``points`` of the straight lines nearest to the quadratic spline through ``values``.

    Nearest in the mean: lines through the values themselves would err to one side wherever the control is
    curved, which adds up over a flight. A control that rests on a bound stays.
    """
    if not np.all((values > bounds[0]) & (values < bounds[1])):
        return values
    coefficients = solve_banded_system(quadratic_splines(knots, points), values)
    breaks = np.union1d(points, knots)
    tau, shares = composite_gauss(breaks, COST_POINTS)
    weights = sparse.diags_array(shares)
    hats = hat_functions(points, tau)
    wanted = hats.T @ (weights @ (quadratic_splines(knots, tau) @ coefficients))
    flown = solve_banded_system(sparse.csr_array(hats.T @ weights @ hats), wanted)
    return flown if np.all((flown >= bounds[0]) & (flown <= bounds[1])) else values
