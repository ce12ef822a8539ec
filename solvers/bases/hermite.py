"""Piecewise cubic states and quadratic controls of the Hermite-Simpson method, and its constants.

On an interval of length h with states x_0, x_1 and slopes f_0, f_1 at its ends, f_m in its middle:

- the cubic through both states and slopes has the middle value
  x_m = (x_0 + x_1) / 2 + h / 8 (f_0 - f_1),
- Simpson's rule gives the defect x_1 - x_0 - h (f_0 + 4 f_m + f_1) / 6.

Source: C. R. Hargraves, S. W. Paris, Direct trajectory optimization using nonlinear programming and
collocation, J. Guidance 10 (1987) 338-342; M. Kelly, SIAM Rev. 59 (2017) 849-904, sections 4 and 5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline, PPoly

# Middle value of the cubic: these times both states, plus h times these times both slopes.
MIDPOINT_VALUES = (1.0 / 2.0, 1.0 / 2.0)
MIDPOINT_SLOPES = (1.0 / 8.0, -1.0 / 8.0)
# Simpson's rule: h times these times the values at the left end, in the middle and at the right end.
SIMPSON = (1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0)


def cubic_pieces(knots: ArrayLike, values: ArrayLike, slopes: ArrayLike) -> CubicHermiteSpline:
    """The states as a function of time: cubic between ``knots`` (n + 1,), with continuous slope.

    ``values`` and ``slopes`` have shape (n + 1,) or (n + 1, m), a column a state. The function takes times of
    any shape, gives derivatives with a second argument, and continues the outer pieces beyond the ends.

    Raises ValueError if the knots do not ascend strictly or the shapes differ.
    """
    breaks, states, rates = (np.asarray(array, dtype=np.float64) for array in (knots, values, slopes))
    return CubicHermiteSpline(breaks, states, rates)


def quadratic_pieces(knots: ArrayLike, left_mid_right: ArrayLike) -> PPoly[np.float64]:
    """The controls as a function of time: on each of n intervals the parabola through three values.

    ``knots`` has shape (n + 1,); ``left_mid_right`` (n, 3) or (n, 3, m): the values at the left end, in the
    middle and at the right end of each interval, for m controls. At a knot where neighbours disagree the
    function takes the value of the right interval.

    Raises ValueError if the knots do not ascend strictly or the shapes do not fit.
    """
    breaks = np.asarray(knots, dtype=np.float64)
    values = np.asarray(left_mid_right, dtype=np.float64)
    lengths = np.diff(breaks)
    if breaks.ndim != 1 or lengths.size == 0 or not np.all(lengths > 0.0):
        raise ValueError("knots must be a row of two numbers or more that ascend strictly")
    if values.ndim not in (2, 3) or values.shape[:2] != (lengths.size, 3):
        raise ValueError(
            f"need values of shape ({lengths.size}, 3) or ({lengths.size}, 3, m), not {values.shape}"
        )
    h: NDArray[np.float64] = lengths.reshape(-1, *[1] * (values.ndim - 2))
    left, middle, right = values[:, 0], values[:, 1], values[:, 2]
    curvature = 2.0 * (left - 2.0 * middle + right) / h**2
    slope = (4.0 * middle - 3.0 * left - right) / h
    return PPoly(np.stack([curvature, slope, left]), breaks)
