"""The cubic spline wavelets on an interval, and their fast transforms to and from B-splines.

Source: Q. Zhang, Z. Feng, Q. Tang, M. Macdonald, A spline wavelet collocation method for the optimal control
of flexible spacecraft, Proc. IMechE Part G: J. Aerospace Engineering, 2014, doi 10.1177/0954410014528885,
equations (3) to (30); after W. Cai, J. Wang, SIAM J. Numer. Anal. 33 (1996) 937-970.

The paper's variable tau runs over [0, L]: knots of level j lie at multiples of 2^-j. The spline space
(:mod:`solvers.bases.cubic_spline`) has the same functions on [0, 1]: tau / L. The scale is the only
difference; coefficients are the same, a derivative of order d differs by the factor L^d.

Functions, in the order of equation (28), and the point at which each interpolates:

- V_0: eta1, eta2, phi_b, phi(tau - k) for k = 0..L-4, and the reflections of phi_b, eta2, eta1 at
  tau = L/2; points 0, 1/2, 1, 2, ..., L - 1, L - 1/2, L. In clamped B-splines B_0, B_1, ... on the integers
  eta1 = B_0, eta2 = 2/3 B_1, phi_b = B_2, phi(tau - k) = B_(k+3).
- W_j, with s = 2^j tau and n_j = 2^j L: psi_b0(s), psi_b1(s), psi(s - k) for k = 1..n_j-4, and the
  reflections of psi_b1 and psi_b0; points s = 1/4, 3/2, 5/2, ..., n_j - 3/2, n_j - 1/4.

Every wavelet of W_j vanishes at all points of V_j, that is of V_0, W_0, ..., W_(j-1); so the coefficients
follow level by level, and within a level the interpolation matrix is tridiagonal with unit diagonal.

The printed equations were corrected where they contradict that, or themselves:

- (4): phi_b lacks its last term, + 1/6 (t - 3)_+^3; without it phi_b does not vanish for t > 3.
- (15): the coefficient at the right end is 3 f(L) / 2 - f'(L) / 2^(j+1): reflection turns the slope's sign.
- (18): the argument of phi_b, as those of eta1 and eta2 in (17), is t, not t - k.
- (21): the reflections are those of psi_b1, at k = n_j-3, and of psi_b0, at k = n_j-2, where (24) and (27)
  end; psi_b0 is printed twice, one k too far. The interior wavelets of (8) are those of k = 1..n_j-4.
- (22): psi_b0 and psi_b1 as printed hold the same bracket, so they cannot both vanish at the point 1/2 of
  V_0 (psi(1/2) = -1/14). With psi_(0,-1) = 12/7 phi_b(2t) - 3/7 phi(2t) and
  psi_(0,-2) = -39/98 eta2(2t) the first is right: psi_b0 = (312 eta2 - 96 phi_b + 24 phi)(2t) / 99.
  In psi_b1 the last term must go: psi_b1 = 182/181 (psi + psi_b / 14), psi_b of (6).
- (25): the last term is g_(J-1), as (26) has it.
- (30): the points are 1/2^(j+2), (2k+3)/2^(j+1) for k = 0..n_j-3, and L - 1/2^(j+2). The printed multiples of
  1/2^(j+1) contain points of V_j, where the wavelets of level j vanish.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from solvers.bases.cubic_spline import CubicSplineSpace

Array = NDArray[np.float64]

# The wavelets in the B-splines of the next finer level: psi from its first spline on, the others from B_1 and
# B_2 on (eta2 = 2/3 B_1).
_PSI = np.array([-3.0, 12.0, -3.0]) / 7.0
_PSI_B0 = np.array([2.0 / 3.0 * 312.0, -96.0, 24.0]) / 99.0
_PSI_B = np.array([24.0, -6.0]) / 13.0
_PSI_B1 = 182.0 / 181.0 * (np.pad(_PSI_B, (0, 2)) / 14.0 + np.pad(_PSI, (1, 0)))
_ETA2 = 2.0 / 3.0


class SplineWaveletBasis:
    """The wavelet basis of V_J = V_0 + W_0 + ... + W_(J-1) on tau in [0, L]; N = 2^J L + 3 functions.

    Wavelet coefficients have shape (N,), or (N, m) for m functions, level after level as in :attr:`order`.
    The same functions in the B-splines of :attr:`spline` have coefficients of the same shape; the transforms
    between the two cost O(N).

    Raises ValueError unless L > 4 and J >= 0.
    """

    def __init__(self, L: int, J: int) -> None:
        if L <= 4:
            raise ValueError(f"the length L must satisfy L > 4, not {L}")
        if J < 0:
            raise ValueError(f"the resolution level J must be 0 or more, not {J}")
        self.L = L
        self.J = J

    @property
    def dimension(self) -> int:
        """Number N = 2^J L + 3 of functions."""
        return self.spline.dimension

    @property
    def order(self) -> list[str]:
        """Names of the levels in the order of the coefficients: V0, W0, ..., W(J-1)."""
        return ["V0", *(f"W{level}" for level in range(self.J))]

    @cached_property
    def spline(self) -> CubicSplineSpace:
        """The B-splines of V_J on [0, 1]."""
        return self._spaces[-1]

    @cached_property
    def points(self) -> Array:
        """The point tau in [0, L] of each function, shape (N,): equations (29) and (30), corrected.

        In the order of the coefficients, ascending within a level.
        """
        points = [self.L * self._spaces[0].interpolation_points]
        for level in range(self.J):
            count = 2**level * self.L
            s = np.concatenate([[0.25], np.arange(count - 2) + 1.5, [count - 0.25]])
            points.append(s / 2**level)
        return np.concatenate(points)

    def levels(self, coefficients: ArrayLike) -> list[Array]:
        """Split coefficients (N,) or (N, m) by level, one array for each name of :attr:`order`."""
        ends = np.cumsum([self.L + 3, *(2**level * self.L for level in range(self.J))])
        return np.split(self._checked(coefficients), ends[:-1])

    def matrix(self, points: ArrayLike, derivative: int = 0) -> sparse.csr_array:
        """Matrix (len(points), N) from coefficients to a derivative with respect to tau, at tau in [0, L].

        At :attr:`points` these are D0, D1 and D2 of equation (41). Unlike the matrices in B-splines they fill
        in: a row holds O(J) entries. ``derivative`` is 0 to 3; raises ValueError as the spline space does.
        """
        scaled = np.asarray(points, dtype=np.float64) / self.L
        in_splines = self.spline.matrix(scaled, derivative) / float(self.L) ** derivative
        return sparse.csr_array(in_splines @ self.synthesis)

    def to_spline(self, coefficients: ArrayLike) -> Array:
        """B-spline coefficients, (N,) or (N, m), of the functions with these wavelet coefficients. O(N)."""
        scaling, *details = self.levels(coefficients)
        coarse: Array = (scaling.T * _scaling_functions(self.L)).T
        for prolongation, wavelets, detail in zip(self._prolongations, self._wavelets, details, strict=True):
            coarse = prolongation @ coarse + wavelets @ detail
        return coarse

    def from_spline(self, coefficients: ArrayLike) -> Array:
        """Wavelet coefficients, (N,) or (N, m), of the functions with these B-spline coefficients. O(N).

        From the finest level down: what V_j interpolates at its points is the coarse part, the rest lies in
        W_j. Each wavelet is the only one with its middle B-spline, so its coefficient can be read off there.
        """
        fine = self._checked(coefficients)
        details: list[Array] = []
        for level in reversed(range(self.J)):
            space = self._spaces[level]
            coarse = space.interpolate(self._restrictions[level] @ fine)
            rest = fine - self._prolongations[level] @ coarse
            position, weight = _middles(self.L * 2**level)
            details.append((rest[position].T / weight).T)
            fine = coarse
        scaling = (fine.T / _scaling_functions(self.L)).T
        return np.concatenate([scaling, *reversed(details)])

    @cached_property
    def synthesis(self) -> sparse.csr_array:
        """Matrix (N, N) of :meth:`to_spline`, with O(J N) entries: column i is function i in B-splines."""
        columns = sparse.csr_array(sparse.diags_array(_scaling_functions(self.L)))
        for prolongation, wavelets in zip(self._prolongations, self._wavelets, strict=True):
            columns = sparse.csr_array(sparse.hstack([prolongation @ columns, wavelets], format="csr"))
        return columns

    @cached_property
    def _spaces(self) -> list[CubicSplineSpace]:
        """The spaces V_0, ..., V_J in B-splines."""
        return [CubicSplineSpace.uniform(2**level * self.L) for level in range(self.J + 1)]

    @cached_property
    def _prolongations(self) -> list[sparse.csr_array]:
        """V_j into V_(j+1), in B-splines, for j = 0..J-1."""
        return [coarse.prolongation(fine) for coarse, fine in pairwise(self._spaces)]

    @cached_property
    def _restrictions(self) -> list[sparse.csr_array]:
        """Values at the points of V_j from B-spline coefficients of V_(j+1), for j = 0..J-1."""
        return [fine.matrix(coarse.interpolation_points) for coarse, fine in pairwise(self._spaces)]

    @cached_property
    def _wavelets(self) -> list[sparse.csr_array]:
        """W_j in the B-splines of V_(j+1), for j = 0..J-1."""
        return [_wavelets(2**level * self.L) for level in range(self.J)]

    def _checked(self, coefficients: ArrayLike) -> Array:
        array = np.asarray(coefficients, dtype=np.float64)
        if array.ndim not in (1, 2) or array.shape[0] != self.dimension:
            raise ValueError(f"need {self.dimension} rows, not an array of shape {array.shape}")
        return array


def _scaling_functions(length: int) -> Array:
    """The functions of V_0 in its B-splines, each a multiple of one: the factors, (L + 3,)."""
    factors = np.ones(length + 3)
    factors[[1, -2]] = _ETA2
    return factors


def _wavelets(count: int) -> sparse.csr_array:
    """The ``count`` wavelets of a level in the B-splines of the next: shape (2 count + 3, count)."""
    last = 2 * count + 2
    inner = np.repeat(np.arange(2, count - 2), 3)
    rows = [np.arange(1, 4), np.arange(2, 6), (2 * inner.reshape(-1, 3) + np.arange(1, 4)).ravel()]
    columns = [np.full(3, 0), np.full(4, 1), inner]
    entries = [_PSI_B0, _PSI_B1, np.tile(_PSI, count - 4)]
    for edge in (0, 1):
        rows.append(last - rows[edge])
        columns.append(count - 1 - columns[edge])
        entries.append(entries[edge])
    indices = (np.concatenate(rows), np.concatenate(columns))
    shape = (2 * count + 3, count)
    return sparse.csr_array(sparse.coo_array((np.concatenate(entries), indices), shape=shape))


def _middles(count: int) -> tuple[NDArray[np.intp], Array]:
    """For each of the ``count`` wavelets of a level the B-spline that it has alone, and its weight there."""
    position = 2 * np.arange(count) + 2
    position[0], position[-1] = 1, 2 * count + 1
    weight = np.full(count, _PSI[1])
    weight[[0, -1]] = _PSI_B0[0]
    weight[[1, -2]] = _PSI_B1[2]
    return position, weight
