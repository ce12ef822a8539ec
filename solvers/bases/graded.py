"""Graded dyadic knots: the mesh on which the cubic spline wavelets adapt, and its wavelet coefficients.

The interval [0, 1] is cut into L equal intervals of level 0; an interval of level j may be split into two of
level j + 1. Neighbours differ by one level at most (a factor 2 in width). The n_j = 2^j L places of level j
are the n_j wavelets of W_j (:mod:`solvers.bases.spline_wavelet`): wavelet i of W_j is active where interval i
of level j is split. So the active set is a tree, and the splines on its knots have as many coefficients as
V_0 has functions and the tree has splits: L + 3 + splits.

Source: W. Cai, J. Wang, SIAM J. Numer. Anal. 33 (1996) 937-970, section 5 (adaptive choice of the collocation
points by the size of the wavelet coefficients); O. V. Vasilyev, C. Bowman, J. Comput. Phys. 165 (2000)
660-693 (second generation wavelets: the same transform on irregular sets of points).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_banded

from solvers.bases.cubic_spline import CubicSplineSpace
from solvers.bases.spline_wavelet import SplineWaveletBasis

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FINEST = 20
"""The highest level that there can be."""

_ETA2 = 2.0 / 3.0  # the second and the last but one function of V_0 in its B-splines


@dataclass(frozen=True)
class GradedKnots:
    """The intervals of an adaptive mesh in ascending order, each by its level (n,); L > 4 roots.

    Raises ValueError if the intervals are not a graded dyadic partition of [0, 1].
    """

    L: int
    levels: Indices

    def __post_init__(self) -> None:
        sizes = 1 << (FINEST - self.levels)
        aligned = np.all(self._starts % sizes == 0) and sizes.sum() == self.L << FINEST
        if self.L <= 4 or not aligned or np.any(np.abs(np.diff(self.levels)) > 1):
            raise ValueError("the intervals must be a graded dyadic partition with L > 4 roots")

    @classmethod
    @lru_cache(maxsize=64)
    def uniform(cls, L: int, J: int) -> GradedKnots:
        """2^J L equal intervals."""
        return cls(L, np.full(L << J, J, np.int64))

    @classmethod
    def from_active(cls, L: int, active: Sequence[ArrayLike]) -> GradedKnots:
        """The mesh with these splits, a list of indices for each level from 0 on.

        Raises ValueError if they are not the splits of a graded mesh.
        """
        marks = np.sort(_knot_marks(L, active))
        sizes = np.diff(marks)
        levels = FINEST - np.log2(sizes).astype(np.int64)
        if np.any(sizes != 1 << (FINEST - levels)):
            raise ValueError("a split interval must be half of a split interval")
        return cls(L, levels)

    @property
    def intervals(self) -> int:
        """Number n of intervals."""
        return self.levels.size

    @property
    def finest(self) -> int:
        """The highest level J of an interval."""
        return int(self.levels.max())

    @property
    def dimension(self) -> int:
        """Number n + 3 of splines on these knots, which is that of active functions."""
        return self.intervals + 3

    @property
    def full(self) -> int:
        """Number 2^J L + 3 of splines on the uniform knots of the finest level."""
        return (self.L << self.finest) + 3

    @property
    def knots(self) -> Array:
        """The n + 1 knots from 0 to 1."""
        return np.append(self._starts, self.L << FINEST) / (self.L << FINEST)

    @cached_property
    def active(self) -> list[Indices]:
        """For each level 0, ..., J - 1 the ascending indices of the intervals that are split."""
        return [
            np.unique(self._starts[self.levels > level] >> (FINEST - level)) for level in range(self.finest)
        ]

    @cached_property
    def space(self) -> CubicSplineSpace:
        """The splines on these knots."""
        return CubicSplineSpace(self.knots)

    def adapted(self, wanted: Indices) -> GradedKnots:
        """The mesh on which each interval is as fine as ``wanted`` (n,) says, and graded.

        Siblings are joined where both want it; an interval is split further where a neighbour demands it.
        """
        levels, wanted = self.levels, np.asarray(wanted, np.int64)
        while np.any(levels < wanted):
            repeats = np.where(levels < wanted, 2, 1)
            levels, wanted = (
                np.repeat(np.where(levels < wanted, levels + 1, levels), repeats),
                np.repeat(wanted, repeats),
            )
        while True:
            starts = _starts(levels)
            pairs = np.flatnonzero(
                (levels[:-1] == levels[1:])
                & (levels[:-1] > 0)
                & (starts[:-1] % (1 << (FINEST + 1 - levels[:-1])) == 0)
                & (np.maximum(wanted[:-1], wanted[1:]) < levels[:-1])
            )
            if not pairs.size:
                break
            levels, joined = levels.copy(), np.maximum(wanted[pairs], wanted[pairs + 1])
            levels[pairs] -= 1
            wanted = wanted.copy()
            wanted[pairs] = joined
            levels, wanted = np.delete(levels, pairs + 1), np.delete(wanted, pairs + 1)
        while True:
            steps = np.diff(levels)
            split = np.zeros(levels.size, bool)
            split[:-1] |= steps > 1
            split[1:] |= steps < -1
            if not split.any():
                return GradedKnots(self.L, levels)
            levels = np.repeat(levels + split, 1 + split)

    def towards(self, place: float, level: int) -> GradedKnots:
        """The mesh that is as fine as ``level`` around ``place`` in [0, 1], and grows coarser away from it.

        An interval less than the finest width away from the place is refined with it.
        """
        reach, mesh = 1.0 / (self.L << level), self
        while True:
            knots = mesh.knots
            near = (knots[1:] > place - reach) & (knots[:-1] < place + reach) & (mesh.levels < level)
            if not near.any():
                return mesh
            mesh = mesh.adapted(mesh.levels + near)

    @property
    def _starts(self) -> Indices:
        return _starts(self.levels)


def _starts(levels: Indices) -> Indices:
    sizes = 1 << (FINEST - levels)
    starts: Indices = np.cumsum(sizes) - sizes
    return starts


def _knot_marks(L: int, active: Sequence[ArrayLike]) -> Indices:
    """The knots as multiples of the finest step: the roots' ends and the middles of the splits."""
    middles = [
        (2 * np.asarray(indices, np.int64) + 1) << (FINEST - 1 - level)
        for level, indices in enumerate(active)
    ]
    return np.concatenate([np.arange(L + 1, dtype=np.int64) << FINEST, *middles])


class GradedWavelets:
    """Wavelet coefficients of the splines on graded dyadic knots, and the way back; O(n) for each level.

    Level by level, coarse to fine, the spline on the knots of levels up to j interpolates the function at its
    own points; what is missing at the points of the active wavelets of W_j is made up by these wavelets,
    whose values there form a tridiagonal matrix. On uniform knots the coefficients are those of
    :class:`~solvers.bases.spline_wavelet.SplineWaveletBasis`; where a finer place ends, the sum of the
    wavelets is continued by the spline that interpolates it on the graded knots.

    Coefficients have shape (N,) or (N, m), N = n + 3, level after level: V_0, then the active ones of
    W_0, ..., W_(J-1).
    """

    def __init__(self, mesh: GradedKnots) -> None:
        self.mesh = mesh
        marks = [_knot_marks(mesh.L, mesh.active[:level]) for level in range(mesh.finest + 1)]
        self._spaces = [CubicSplineSpace(np.sort(mark) / (mesh.L << FINEST)) for mark in marks]

    @property
    def spline(self) -> CubicSplineSpace:
        """The splines on the knots."""
        return self._spaces[-1]

    @property
    def order(self) -> list[str]:
        """Names of the levels in the order of the coefficients: V0, W0, ..., W(J-1)."""
        return ["V0", *(f"W{level}" for level in range(self.mesh.finest))]

    @property
    def sizes(self) -> list[int]:
        """How many coefficients each level has, in the order of :attr:`order`."""
        return [self.mesh.L + 3, *(indices.size for indices in self.mesh.active)]

    def from_spline(self, coefficients: Array) -> Array:
        """Wavelet coefficients of the functions with these B-spline coefficients, of the same shape."""
        space = self._spaces[0]
        coarse = space.interpolate(self.spline.evaluate(coefficients, space.interpolation_points))
        found = [(coarse.T / _scaling(self.mesh.L)).T]
        for level, indices in enumerate(self.mesh.active):
            points = self._points(level, indices)
            missing = self.spline.evaluate(coefficients, points) - space.evaluate(coarse, points)
            found.append(solve_banded((1, 1), _values_at_points(self.mesh.L << level, indices), missing))
            space = self._spaces[level + 1]
            coarse = space.interpolate(self.spline.evaluate(coefficients, space.interpolation_points))
        return np.concatenate(found)

    def to_spline(self, coefficients: Array) -> Array:
        """B-spline coefficients of the functions with these wavelet coefficients, of the same shape."""
        scaling, *details = np.split(coefficients, np.cumsum(self.sizes)[:-1])
        space, coarse = self._spaces[0], (scaling.T * _scaling(self.mesh.L)).T
        known = space.evaluate(coarse, space.interpolation_points)
        for level, (indices, detail) in enumerate(zip(self.mesh.active, details, strict=True)):
            finer = self._spaces[level + 1]
            points, places = finer.interpolation_points, self._points(level, indices)
            new = np.searchsorted(points, places - 1.0 / (16 * (self.mesh.L << level)))
            # Values that are known stay as they are: taken from the coarse spline anew, they would round
            # from level to level.
            values = np.insert(known, new - np.arange(new.size), 0.0, axis=0)
            values[new] = space.evaluate(coarse, places) + _multiply_banded(
                _values_at_points(self.mesh.L << level, indices), detail
            )
            space, coarse, known = finer, finer.interpolate(values), values
        return coarse

    def _points(self, level: int, indices: Indices) -> Array:
        """The points in [0, 1] of these wavelets: middles of their intervals, a quarter in at the ends."""
        count = self.mesh.L << level
        quarters = np.where(indices == 0, 1, np.where(indices == count - 1, 3, 2))
        return (4 * indices + quarters) / (4 * count)


def _scaling(length: int) -> Array:
    """The functions of V_0 in its B-splines: a diagonal, (L + 3,)."""
    factors = np.ones(length + 3)
    factors[[1, -2]] = _ETA2
    return factors


def _values_at_points(count: int, indices: Indices) -> Array:
    """Values of these wavelets of a level at the points of one another, as the bands of a matrix, (3, K)."""
    above, below = _neighbours()
    reach = above.size
    bands = np.zeros((3, indices.size))
    bands[1] = 1.0
    adjacent = np.flatnonzero(np.diff(indices) == 1)
    left = indices[adjacent]
    # The stencil of a short level, with its inner entries repeated.
    place = np.where(
        left < min(reach // 2, count // 2), left, np.maximum(left - (count - 1) + reach, reach // 2)
    )
    bands[0, adjacent + 1] = above[place]
    bands[2, adjacent] = below[place]
    return bands


@lru_cache(maxsize=1)
def _neighbours() -> tuple[Array, Array]:
    """T(i, i+1) and T(i+1, i) of level 0 over 8 intervals, (7,); T(i, k) is wavelet k at the point of i."""
    basis = SplineWaveletBasis(8, 1)
    wavelets = slice(11, None)
    values = basis.matrix(basis.points[wavelets]).toarray()[:, wavelets]
    return np.diagonal(values, 1), np.diagonal(values, -1)


def _multiply_banded(bands: Array, vectors: Array) -> Array:
    product: Array = (bands[1] * vectors.T).T
    product[:-1] += (bands[0, 1:] * vectors[1:].T).T
    product[1:] += (bands[2, :-1] * vectors[:-1].T).T
    return product
