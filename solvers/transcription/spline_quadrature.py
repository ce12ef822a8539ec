"""Integrals on the knots of splines: by Simpson, and the means over hat functions.

The second derivative of a cubic spline is linear between the knots. Held to an equation at the knots alone,
it errs to one side wherever it is curved, which adds up to h^2 over a flight. Held to it in the mean over
each hat function, it errs to both sides. What moves the end of a flight is the residual against a costate,
which is nearly linear between two knots: so the end is right to h^4, on graded knots as on equal ones. A
control that is linear between the knots is met exactly by either, also where it jumps within one interval.

Source: C. de Boor, B. Swartz, SIAM J. Numer. Anal. 10 (1973) 582-606, for why a residual that is orthogonal
to polynomials makes the ends more exact than what lies between.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.bases.legendre import composite_gauss
from solvers.transcription.spline_controls import hat_functions

Vector = NDArray[np.float64]

# Products of a hat with quadratic functions are integrated exactly.
_MEAN_POINTS = 2


def simpson(knots: Vector) -> tuple[Vector, Vector]:
    """Knots and middles of n intervals, and the weights of Simpson's rule; both (2 n + 1,)."""
    points, weights = np.empty(2 * knots.size - 1), np.zeros(2 * knots.size - 1)
    points[::2], points[1::2] = knots, (knots[1:] + knots[:-1]) / 2
    widths = np.diff(knots)
    weights[:-2:2] += widths / 6
    weights[1::2] += 4 * widths / 6
    weights[2::2] += widths / 6
    return points, weights


def hat_means(knots: Vector) -> tuple[Vector, sparse.csr_array]:
    """Gauss points (2 n,) between n + 1 knots, and the rows (n + 1, 2 n) of the means over the hats there."""
    tau, weights = composite_gauss(knots, _MEAN_POINTS)
    weighted = hat_functions(knots, tau).T @ sparse.diags_array(weights)
    return tau, sparse.csr_array(sparse.diags_array(1.0 / weighted.sum(axis=1)) @ weighted)
