"""Legendre-Gauss nodes and weights, Lagrange interpolation and differentiation on them, on [-1, 1].

Sources: D. A. Benson, A Gauss pseudospectral transcription for optimal control, PhD thesis, MIT 2005 (the
method); J.-P. Berrut, L. N. Trefethen, Barycentric Lagrange interpolation, SIAM Rev. 46 (2004) 501-517;
H. Wang, D. Huybrechs, S. Vandewalle, Explicit barycentric weights for polynomial interpolation in the roots
or extrema of classical orthogonal polynomials, Math. Comp. 83 (2014) 2893-2914.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def legendre_gauss(count: int) -> tuple[Array, Array]:
    """Nodes and weights of Gauss quadrature: the ``count`` roots of P_count, ascending, and their weights.

    Both of shape (count,); exact for polynomials up to degree 2 count - 1 over [-1, 1].
    Raises ValueError if ``count`` is less than 1.
    """
    gaps, slopes = _half_roots(count)
    weights = 2.0 / (gaps * (2.0 - gaps) * slopes**2)
    return _mirrored(gaps - 1.0, count, -1.0), _mirrored(weights, count, 1.0)


def composite_gauss(breaks: Array, count: int) -> tuple[Array, Array]:
    """``count`` Gauss points in each of the K intervals between ``breaks``, and their weights; (K count,)."""
    nodes, weights = legendre_gauss(count)
    widths = np.diff(breaks)[:, None]
    return (breaks[:-1, None] + widths * (nodes + 1.0) / 2.0).ravel(), (widths * weights / 2.0).ravel()


def gauss_support(count: int) -> Array:
    """Support points (count + 1,) of the state in the Gauss pseudospectral method: -1 and the Gauss nodes."""
    return np.concatenate([[-1.0], legendre_gauss(count)[0]])


def gauss_barycentric_weights(count: int, *, initial_point: bool) -> Array:
    """Barycentric weights of the Gauss nodes, (count,), or with -1 before them, (count + 1,).

    In closed form: 1 / P'(x_k) for the nodes alone, 1 / ((1 + x_k) P'(x_k)) and 1 / P(-1) with -1, where P is
    the Legendre polynomial of degree ``count``. Raises ValueError if ``count`` is less than 1.
    """
    gaps, slopes = _half_roots(count)
    signs = (-1.0) ** (count - np.arange(count + 1))
    derivatives = signs[1:] * _mirrored(slopes, count, 1.0)
    if not initial_point:
        return 1.0 / derivatives
    from_start = np.concatenate([gaps, 2.0 - gaps[: count // 2][::-1]])
    return np.concatenate([signs[:1], 1.0 / (from_start * derivatives)])


def barycentric_weights(points: ArrayLike) -> Array:
    """Barycentric weights of any distinct ``points``, (n,), scaled so that the largest has magnitude 1.

    Products of mantissas and sums of exponents are formed apart, so hundreds of points neither overflow nor
    vanish and no digits are lost in logarithms.
    Raises ValueError if two points coincide.
    """
    x = np.asarray(points, dtype=np.float64)
    differences = x[:, None] - x[None, :]
    np.fill_diagonal(differences, 1.0)
    if np.any(differences == 0.0):
        raise ValueError("the points of an interpolation must be distinct")
    mantissas, exponents = np.frexp(differences)
    weights = 1.0 / np.prod(mantissas, axis=1)
    powers = -exponents.sum(axis=1)
    weights = np.ldexp(weights, powers - powers.max())
    scaled: Array = weights / np.abs(weights).max()
    return scaled


def lagrange_matrix(points: ArrayLike, weights: ArrayLike, at: ArrayLike) -> Array:
    """Matrix (len(at), len(points)) from values at ``points`` to the interpolating polynomial ``at`` others.

    ``weights`` are the barycentric weights of the points, in any scale. A place that is one of the points
    takes the value there.
    """
    x, weight = np.asarray(points, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    differences = np.asarray(at, dtype=np.float64)[:, None] - x[None, :]
    matrix: Array = (differences == 0.0).astype(np.float64)
    between = ~matrix.any(axis=1)
    terms = weight / differences[between]
    matrix[between] = terms / terms.sum(axis=1, keepdims=True)
    return matrix


def differentiation_matrix(points: ArrayLike, weights: ArrayLike) -> Array:
    """Matrix (n, n) from values at ``points`` to the derivative there of the interpolating polynomial.

    ``weights`` are the barycentric weights of the points, in any scale. Each diagonal entry is the negative
    sum of its row, so that constants have derivative zero exactly and rounding stays small.
    """
    x, weight = np.asarray(points, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    differences = x[:, None] - x[None, :]
    np.fill_diagonal(differences, 1.0)
    matrix: Array = (weight[None, :] / weight[:, None]) / differences
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix


def gauss_differentiation_matrix(count: int) -> Array:
    """The Gauss pseudospectral D, (count, count + 1): from values at the support to derivatives at the nodes.

    Columns follow :func:`gauss_support`: -1, then the nodes. Exact for polynomials up to degree ``count``.
    """
    weights = gauss_barycentric_weights(count, initial_point=True)
    return differentiation_matrix(gauss_support(count), weights)[1:]


@lru_cache(maxsize=64)
def _half_roots(count: int) -> tuple[Array, Array]:
    """Roots of P_count in [-1, 0] as gaps 1 + x, ascending, and abs(P') there: each (ceil(count / 2),).

    Newton's iteration in the gap y, with the three-term recurrence in terms of y and of differences
    P_k - P_(k-1) (by symmetry at 1 - y): so nodes beside the ends keep their relative accuracy.
    """
    if count < 1:
        raise ValueError(f"the number of Gauss nodes must be 1 or more, not {count}")
    number = np.arange(1, (count + 1) // 2 + 1)
    gaps = 2.0 * np.sin(np.pi * (4 * number - 1) / (8 * count + 4)) ** 2
    for _ in range(4):
        value, slope = _legendre(count, gaps)
        gaps = gaps + value / slope
    slopes = np.abs(_legendre(count, gaps)[1])
    # Every caller gets the same two arrays.
    gaps.flags.writeable = slopes.flags.writeable = False
    return gaps, slopes


def _legendre(degree: int, gaps: Array) -> tuple[Array, Array]:
    """P and P' of ``degree`` at 1 - y for gaps y in (0, 1]."""
    value, difference = 1.0 - gaps, -gaps
    for k in range(1, degree):
        difference = (k * difference - (2 * k + 1) * gaps * value) / (k + 1)
        value = value + difference
    return value, degree * (gaps * value - difference) / (gaps * (2.0 - gaps))


def _mirrored(half: Array, count: int, sign: float) -> Array:
    """All ``count`` entries from those of the left half, the right half being ``sign`` times their mirror."""
    return np.concatenate([half, sign * half[: count // 2][::-1]])
