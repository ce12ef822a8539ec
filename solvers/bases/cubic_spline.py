"""Twice continuously differentiable cubic splines on [0, 1] in the banded B-spline basis.

On 2^J L equal intervals this is the space of the interval spline wavelets of level J
(:mod:`solvers.bases.spline_wavelet`): the same functions, but with matrices that stay banded. Any ascending
knots are allowed, for instance graded dyadic ones.

Source: C. de Boor, A Practical Guide to Splines, revised edition, Springer 2001, chapters IX to XIII.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.interpolate import BSpline

from solvers.bases.banded import BandedMatrix, solve_banded_system
from solvers.bases.legendre import composite_gauss

Array = NDArray[np.float64]

DEGREE = 3
# Points this far outside [0, 1], and knots this far apart, differ by rounding and not by mistake.
_ROUNDING = 1e-12


class CubicSplineSpace:
    """The cubic C2 splines on n >= 2 intervals of [0, 1], spanned by N = n + 3 clamped B-splines.

    ``knots`` has shape (n + 1,), strictly ascending from 0 to 1. Coefficients have shape (N,) or (N, m), a
    column for each of m functions. Derivatives are with respect to the variable on [0, 1].

    Raises ValueError for knots that are not strictly ascending from 0 to 1 or form fewer than two intervals.
    """

    def __init__(self, knots: ArrayLike) -> None:
        breaks = np.array(knots, dtype=np.float64)
        if breaks.ndim != 1 or breaks.size < 3:
            raise ValueError(f"knots must be a row of 3 numbers or more, not of shape {breaks.shape}")
        if breaks[0] != 0.0 or breaks[-1] != 1.0 or not np.all(np.diff(breaks) > 0.0):
            raise ValueError("knots must ascend strictly from 0 to 1")
        breaks.flags.writeable = False
        self.knots: Array = breaks

    @classmethod
    def uniform(cls, intervals: int) -> CubicSplineSpace:
        """The space on ``intervals`` equal intervals; knots k / n are nested exactly when n is doubled."""
        return cls(np.arange(intervals + 1) / intervals)

    @property
    def intervals(self) -> int:
        """Number n of intervals between knots."""
        return self.knots.size - 1

    @property
    def dimension(self) -> int:
        """Number N = n + 3 of coefficients of one function."""
        return self.intervals + DEGREE

    def matrix(self, points: ArrayLike, derivative: int = 0) -> sparse.csr_array:
        """Matrix (len(points), N) that maps coefficients to the ``derivative``-th derivative at ``points``.

        ``derivative`` is 0 to 3. The third derivative jumps at knots; there it is the limit from the right
        (from the left at 1). At knots a row holds at most three entries for the derivatives 0, 1 and 2.

        Raises ValueError for points outside [0, 1] or another order of derivative.
        """
        _check_derivative(derivative)
        degree = DEGREE - derivative
        basis = sparse.csr_array(BSpline.design_matrix(_inside(points), self._clamped(degree), degree))
        basis.eliminate_zeros()
        matrix = sparse.csr_array(basis @ self._difference(derivative))
        matrix.sort_indices()
        return matrix

    def evaluate(self, coefficients: ArrayLike, points: ArrayLike, derivative: int = 0) -> Array:
        """The ``derivative``-th derivative of the functions at ``points``: shape (len(points),) or (.., m).

        Raises ValueError for points outside [0, 1], another order of derivative, or misshapen coefficients.
        """
        _check_derivative(derivative)
        # Without the checks of BSpline, which take as long as the evaluation: they hold for this space.
        spline = BSpline.construct_fast(self._knots_of_splines, self._checked(coefficients), DEGREE)
        values: Array = spline(_inside(points), nu=derivative)
        return values

    def greville(self, derivative: int = 0) -> Array:
        """Greville points of the space, of degree 3 - ``derivative``, in which that derivative lives.

        Ascending, shape (N - derivative,): as many points as that space has dimensions, the right places to
        collocate an equation in that derivative. Order 2 gives the knots, order 1 both ends and the midpoints
        of the intervals, order 3 the midpoints alone.
        """
        _check_derivative(derivative)
        degree = DEGREE - derivative
        if degree == 0:
            return (self.knots[:-1] + self.knots[1:]) / 2.0
        clamped = self._clamped(degree)
        count = self.dimension - derivative
        points: Array = np.mean([clamped[1 + k : 1 + k + count] for k in range(degree)], axis=0)
        return points

    def quadrature_weights(self, derivative: int = 0) -> Array:
        """Weights (N - derivative,) at ``greville(derivative)`` that integrate over [0, 1].

        Exact for the splines of degree 3 - derivative on these knots. For order 1 they are the weights w with
        w D1 = e(1) - e(0), where D1 = matrix(greville(1), 1) and e(t) is the row of values at t.
        """
        points = self.greville(derivative)
        degree = DEGREE - derivative
        clamped = self._clamped(degree)
        integrals = (clamped[degree + 1 :] - clamped[: -degree - 1]) / (degree + 1)
        values = BSpline.design_matrix(points, clamped, degree)
        weights: Array = solve_banded_system(sparse.csr_array(values.T), integrals)
        return weights

    def dual_values(self, weights: ArrayLike, derivative: int) -> Array:
        """Values at ``greville(derivative)`` of the function whose integral against g is weights' g.

        g is any spline of degree d = 3 - ``derivative`` on these knots, given by its values at those points;
        ``weights`` has shape (N - derivative,) or (.., m). The function is sought among the same splines: it
        is the projection in the mean of whatever has these integrals. O(N).
        """
        points, degree = self.greville(derivative), DEGREE - derivative
        clamped = self._clamped(degree)
        at_points = sparse.csr_array(BSpline.design_matrix(points, clamped, degree))
        inside, shares = composite_gauss(self.knots, degree + 1)
        values = sparse.csr_array(BSpline.design_matrix(inside, clamped, degree))
        gram = values.T @ sparse.diags_array(shares) @ values
        moments = np.asarray(at_points.T @ np.asarray(weights, np.float64), np.float64)
        coefficients = solve_banded_system(sparse.csr_array(gram), moments)
        return np.asarray(at_points @ coefficients, np.float64)

    @cached_property
    def interpolation_points(self) -> Array:
        """The N points of :meth:`interpolate`: the knots and the midpoints of the first and last interval."""
        knots = self.knots
        first, last = (knots[0] + knots[1]) / 2.0, (knots[-2] + knots[-1]) / 2.0
        return np.concatenate([knots[:1], [first], knots[1:-1], [last], knots[-1:]])

    def interpolate(self, values: ArrayLike) -> Array:
        """Coefficients (N,) or (N, m) of the splines with ``values`` at :attr:`interpolation_points`.

        ``values`` has shape (N,) or (N, m), in the ascending order of the points. One banded solve, O(N).
        """
        return self._interpolation.solve(self._checked(values))

    @cached_property
    def _interpolation(self) -> BandedMatrix:
        """Values at the points of :meth:`interpolate` from coefficients."""
        return BandedMatrix(self.matrix(self.interpolation_points))

    def prolong(self, coefficients: ArrayLike, finer: CubicSplineSpace) -> Array:
        """Coefficients of the same functions in the ``finer`` space, whose knots contain these. O(N).

        Raises ValueError if a knot of this space is not a knot of the finer one.
        """
        prolonged: Array = self.prolongation(finer) @ self._checked(coefficients)
        return prolonged

    def prolongation(self, finer: CubicSplineSpace) -> sparse.csr_array:
        """Matrix (finer.dimension, N) of :meth:`prolong`, at most four entries in a row.

        A coefficient of a spline is the blossom of its polynomial piece at three successive knots; each row
        evaluates the coarse blossom at three fine knots (the Oslo algorithm; Cohen, Lyche, Riesenfeld 1980).
        """
        if np.any(np.abs(_nearest(finer.knots, self.knots) - self.knots) > _ROUNDING):
            raise ValueError("the finer space must contain every knot of the coarser one")
        coarse, fine = self._clamped(DEGREE), finer._clamped(DEGREE)
        rows = np.arange(finer.dimension)
        # No knot lies in the middle of a fine interval: rounding cannot pick a wrong piece there.
        starts = np.searchsorted(finer.knots, fine[rows], side="right") - 1
        middles = (finer.knots[starts] + finer.knots[starts + 1]) / 2.0
        pieces = np.searchsorted(self.knots, middles, side="right") - 1 + DEGREE
        entries = np.ones((rows.size, 1))
        for degree in range(1, DEGREE + 1):
            at = fine[rows + degree]
            raised = np.zeros((rows.size, degree + 1))
            for column in range(degree):
                left = coarse[pieces - degree + 1 + column]
                right = coarse[pieces + 1 + column]
                fraction = (at - left) / (right - left)
                raised[:, column] += (1.0 - fraction) * entries[:, column]
                raised[:, column + 1] += fraction * entries[:, column]
            entries = raised
        columns = pieces[:, None] + np.arange(-DEGREE, 1)
        indices = (np.repeat(rows, DEGREE + 1), columns.ravel())
        shape = (finer.dimension, self.dimension)
        matrix = sparse.csr_array(sparse.coo_array((entries.ravel(), indices), shape=shape))
        matrix.eliminate_zeros()
        return matrix

    @cached_property
    def _knots_of_splines(self) -> Array:
        return self._clamped(DEGREE)

    def _clamped(self, degree: int) -> Array:
        """Knot vector of the B-splines of ``degree``: both ends stand ``degree`` times more."""
        return np.concatenate([np.zeros(degree), self.knots, np.ones(degree)])

    def _difference(self, derivative: int) -> sparse.csr_array:
        """Matrix (N - derivative, N) to the coefficients of the derivative in the B-splines it lives in."""
        matrix = sparse.csr_array(sparse.eye_array(self.dimension))
        for degree in range(DEGREE, DEGREE - derivative, -1):
            clamped = self._clamped(degree)
            count = self.intervals + degree - 1
            slope = degree / (clamped[degree + 1 : degree + 1 + count] - clamped[1 : 1 + count])
            row = np.arange(count)
            entries = np.concatenate([-slope, slope])
            indices = (np.concatenate([row, row]), np.concatenate([row, row + 1]))
            step = sparse.coo_array((entries, indices), shape=(count, count + 1))
            matrix = sparse.csr_array(step.tocsr() @ matrix)
        return matrix

    def _checked(self, coefficients: ArrayLike) -> Array:
        array = np.asarray(coefficients, dtype=np.float64)
        if array.ndim not in (1, 2) or array.shape[0] != self.dimension:
            raise ValueError(f"need {self.dimension} rows, not an array of shape {array.shape}")
        return array


def _check_derivative(derivative: int) -> None:
    if not 0 <= derivative <= DEGREE:
        raise ValueError(f"the order of derivative must be 0 to {DEGREE}, not {derivative}")


def _inside(points: ArrayLike) -> Array:
    array = np.asarray(points, dtype=np.float64)
    if not np.all((array >= -_ROUNDING) & (array <= 1.0 + _ROUNDING)):
        raise ValueError("points must lie in [0, 1]")
    return np.clip(array, 0.0, 1.0)


def _nearest(sorted_values: Array, wanted: Array) -> Array:
    """The element of ``sorted_values`` closest to each of ``wanted``."""
    right = np.clip(np.searchsorted(sorted_values, wanted), 1, sorted_values.size - 1)
    below, above = sorted_values[right - 1], sorted_values[right]
    return np.where(wanted - below < above - wanted, below, above)
