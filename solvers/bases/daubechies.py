"""Daubechies' scaling functions and wavelets over an interval, exact at dyadic points.

The scaling function of order N obeys phi(x) = sum_n h_n phi(2 x - n), n = 0 ... 2 N - 1, with sum h = 2; the
wavelet is psi(x) = sum_n g_n phi(2 x - n), g_n = (-1)^n h_(2 N - 1 - n); both live on [0, 2 N - 1]. At
integers phi is an eigenvector; the two-scale relation then gives it exactly at all dyadic points, and
likewise its integral, Phi(x) = 1/2 sum_n h_n Phi(2 x - n).

A basis over tau in [0, 1], x = n tau, in the order of its coefficients:

    V0: phi(x - k), k = 0 ... n - 1
    Wj: 2^(j/2) psi(2^j x - k), k = 0 ... n 2^j - 1;  j = 0 ... levels - 1

periodic: wrapped around, which leaves them orthogonal. On the interval: the translates that reach into it,
cut off and made orthonormal; x = s tau with s = n - 2 N + 2, so that there are n of them as well. The square
of every function has the integral 1/n (1/s) over tau.

Source: Daubechies, "Orthonormal bases of compactly supported wavelets", Comm. Pure Appl. Math. 41 (1988),
909-996; on the interval: Andersson, Hall, Jawerth, Peters, "Wavelets on closed subsets of the real line"
(1993).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Vector = NDArray[np.float64]

ORDERS = range(2, 11)
"""Orders N that there are: those of Daubechies' table."""
INTERVAL_ORDERS = range(2, 5)
"""Orders that there are on the interval: of higher ones too little is left of the translates at its ends."""

# Dyadic intervals of an answer, and levels below the finest functions, at least: measured on the solar array,
# optima are exact to 2e-8 then.
_ANSWER_INTERVALS = 320
_BELOW = 3


@lru_cache
def scaling_filter(order: int) -> Vector:
    """h, (2 N,), sum 2: extremal phase, as in Daubechies' table.

    Spectral factorisation: |H|^2 = (1 - y)^N sum_k C(N - 1 + k, k) y^k with y = (2 - z - 1/z) / 4, of which
    the zeros inside the unit circle are taken.
    """
    if order not in ORDERS:
        raise ValueError(f"order: {order}, must be between {ORDERS[0]} and {ORDERS[-1]}")
    polynomial = [comb(order - 1 + k, k) for k in range(order)]
    middle = 1.0 - 2.0 * np.roots(polynomial[::-1])
    pairs = middle[:, None] + np.sqrt(middle**2 - 1.0)[:, None] * np.array([1.0, -1.0])
    inside = pairs[np.abs(pairs) < 1.0]
    taps = np.real(np.poly(np.concatenate([np.full(order, -1.0), inside])))
    return np.asarray(2.0 * taps / taps.sum(), np.float64)


@lru_cache(maxsize=64)
def scaling_values(order: int, level: int) -> Vector:
    """phi(i / 2^level), i = 0 ... (2 N - 1) 2^level."""
    taps = scaling_filter(order)
    width = taps.size - 1
    if level == 0:
        inner = np.arange(1, width)
        matrix = _taps_at(taps, 2 * inner[:, None] - inner[None, :])
        system = np.vstack([matrix - np.eye(width - 1), np.ones(width - 1)])
        solution = linalg.lstsq(system, np.append(np.zeros(width - 1), 1.0))[0]
        return np.concatenate([[0.0], solution, [0.0]])
    return _refined(taps, scaling_values(order, level - 1), level, 0.0)


@lru_cache(maxsize=64)
def scaling_integrals(order: int, level: int) -> Vector:
    """The integral of phi from 0 to i / 2^level, i = 0 ... (2 N - 1) 2^level."""
    taps = scaling_filter(order)
    width = taps.size - 1
    if level == 0:
        inner = np.arange(1, width)
        matrix = 0.5 * _taps_at(taps, 2 * inner[:, None] - inner[None, :])
        beyond = 0.5 * np.array([taps[: max(0, 2 * k - width + 1)].sum() for k in inner])
        return np.concatenate([[0.0], np.linalg.solve(np.eye(width - 1) - matrix, beyond), [1.0]])
    return 0.5 * _refined(taps, scaling_integrals(order, level - 1), level, 1.0)


def _taps_at(taps: Vector, index: NDArray[np.int_]) -> Vector:
    """Filter taps at integer places, 0 outside."""
    found = np.where((index >= 0) & (index < taps.size), taps[np.clip(index, 0, taps.size - 1)], 0.0)
    return np.asarray(found, np.float64)


def _refined(taps: Vector, coarse: Vector, level: int, beyond: float) -> Vector:
    """sum_n h_n f(2 x - n) on the points of ``level``, from f on the level below, ``beyond`` right of it."""
    shift = 1 << (level - 1)
    places = np.arange((taps.size - 1) * 2 * shift + 1)
    result = np.zeros(places.size)
    for n, tap in enumerate(taps):
        result += tap * _looked_up(coarse, places - n * shift, beyond)
    return result


def _looked_up(values: Vector, index: NDArray[np.int_], beyond: float) -> Vector:
    """``values`` at integer places, 0 on their left and ``beyond`` on their right."""
    inside = values[np.clip(index, 0, values.size - 1)]
    return np.where(index < 0, 0.0, np.where(index >= values.size, beyond, inside))


@dataclass(frozen=True)
class DaubechiesBasis:
    """The functions of order ``order`` over tau in [0, 1]; see the top of this file.

    ``scaling_functions``: n; ``levels`` of wavelets above them; ``periodic``, or on the interval.
    """

    order: int
    scaling_functions: int
    levels: int = 0
    periodic: bool = True

    def __post_init__(self) -> None:
        if not self.periodic and self.order not in INTERVAL_ORDERS:
            raise ValueError(f"order: {self.order} on the interval, at most {INTERVAL_ORDERS[-1]}")
        if self.units < 1:
            raise ValueError(
                f"scaling_functions: {self.scaling_functions}, on the interval at least {2 * self.order - 1}"
            )

    @property
    def units(self) -> int:
        """The length of the interval in units of x."""
        return self.scaling_functions - (0 if self.periodic else 2 * self.order - 2)

    @property
    def blocks(self) -> dict[str, int]:
        """How many functions there are of V0, W0, W1, ..., in the order of the coefficients."""
        wavelets = {f"W{j}": self.units << j for j in range(self.levels)}
        return {"V0": self.scaling_functions, **wavelets}

    @property
    def size(self) -> int:
        """The number of functions."""
        return sum(self.blocks.values())

    @property
    def answer_level(self) -> int:
        """The level on which answers are tabulated."""
        return self.level_for(_ANSWER_INTERVALS)

    def level_for(self, intervals: int) -> int:
        """The level with so many dyadic intervals at least, and some on the support of every function."""
        level = self.levels + _BELOW
        while self.units << level < intervals:
            level += 1
        return level

    def points(self, level: int) -> Vector:
        """The dyadic points tau = i / (units 2^level)."""
        return np.linspace(0.0, 1.0, (self.units << level) + 1)

    def values(self, level: int) -> Vector:
        """Every function at :meth:`points`: (size, units 2^level + 1). ``level`` is at least ``levels``."""
        return self._tabulate(scaling_values(self.order, level - self.levels), level, 0.0, 1.0)

    def integrals(self, level: int) -> Vector:
        """The integral over tau from 0 of every function, at :meth:`points`."""
        table = scaling_integrals(self.order, level - self.levels)
        tabulated = self._tabulate(table, level, 1.0, 1.0 / (self.units << self.levels))
        return np.asarray(tabulated - tabulated[:, :1], np.float64)

    def parabolas(self, level: int) -> Vector:
        """Every function as parabolas between :meth:`points`: values at ends and middles in turn.

        (size, 2 units 2^level + 1). The ends are exact; the middles give each interval its exact integral.
        """
        ends = self.values(level)
        width = 1.0 / (self.units << level)
        middles = (6.0 / width * np.diff(self.integrals(level)) - ends[:, :-1] - ends[:, 1:]) / 4.0
        table = np.empty((self.size, 2 * ends.shape[1] - 1))
        table[:, ::2], table[:, 1::2] = ends, middles
        return table

    def _tabulate(self, table: Vector, level: int, beyond: float, factor: float) -> Vector:
        """Synthesis of the finest translates 2^(levels/2) f(2^levels x - k), given f at dyadic points."""
        shift = 1 << (level - self.levels)
        places = np.arange((self.units << level) + 1)
        rows = np.array([self._translate(table, places - k * shift, level, beyond) for k in self._finest])
        scale = factor * 2.0 ** (self.levels / 2)
        return np.asarray(scale * (self._synthesis @ rows), np.float64)

    def _translate(self, table: Vector, places: NDArray[np.int_], level: int, beyond: float) -> Vector:
        if not self.periodic:
            return _looked_up(table, places, beyond)
        period = self.units << level
        turns = range(-(table.size // period) - 1, 1)
        shifted = [_looked_up(table, places - turn * period, beyond) for turn in turns]
        return np.asarray(np.sum(shifted, axis=0), np.float64)

    @property
    def _finest(self) -> range:
        return _translates(self, self.levels)

    @cached_property
    def _synthesis(self) -> Vector:
        """Every function as a combination of the finest translates, (size, translates)."""
        rows = _first_rows(self)
        for level in range(self.levels):
            scaling, wavelets = _two_scale(self, level)
            coarse = rows @ scaling
            rows = np.vstack([coarse, _wavelet_rows(self, level, coarse, wavelets)])
        return rows


def _translates(basis: DaubechiesBasis, level: int) -> range:
    """The k for which phi(2^level x - k) belongs to the basis."""
    return range(0 if basis.periodic else 2 - 2 * basis.order, basis.units << level)


def _two_scale(basis: DaubechiesBasis, level: int) -> tuple[Vector, Vector]:
    """Translates of ``level``, scaling functions and wavelets, by those of the next: two matrices."""
    taps = scaling_filter(basis.order) / np.sqrt(2.0)
    signs = (-1.0) ** np.arange(taps.size)
    coarse, fine = _translates(basis, level), _translates(basis, level + 1)
    matrices = np.zeros((2, len(coarse), len(fine)))
    for row, k in enumerate(coarse):
        for n, pair in enumerate(zip(taps, signs * taps[::-1], strict=True)):
            column = (2 * k + n) % len(fine) if basis.periodic else 2 * k + n - fine.start
            if 0 <= column < len(fine):  # else it lies outside of the interval
                matrices[:, row, column] += pair
    return matrices[0], matrices[1]


def _first_rows(basis: DaubechiesBasis) -> Vector:
    """V0 by the translates of level 0: themselves, or made orthonormal with as little change as can be."""
    if basis.periodic:
        return np.eye(basis.units)
    values, vectors = np.linalg.eigh(_gram(basis, 0))
    return np.asarray(vectors / np.sqrt(values) @ vectors.T, np.float64)


def _wavelet_rows(basis: DaubechiesBasis, level: int, coarse: Vector, wavelets: Vector) -> Vector:
    """W_level by the translates of the next level, from the translates of psi; ``coarse``: what is below.

    On the interval: what of them is orthogonal to everything below, made orthonormal; those that lie inside
    come first and stay as they are.
    """
    if basis.periodic:
        return wavelets
    gram = _gram(basis, level + 1)
    kept = np.zeros((0, gram.shape[0]))
    below = np.array(coarse)
    lengths = np.einsum("ij,jk,ik->i", wavelets, gram, wavelets)
    for _ in range(basis.units << level):
        rest = wavelets - (wavelets @ gram @ below.T) @ below
        rest -= (rest @ gram @ below.T) @ below
        left = np.einsum("ij,jk,ik->i", rest, gram, rest) / lengths
        # The largest remainder, the first of equal ones.
        best = int(np.argmax(np.round(left, 9)))
        row = rest[best] / np.sqrt(rest[best] @ gram @ rest[best])
        kept, below = np.vstack([kept, row]), np.vstack([below, row])
    return kept


def _gram(basis: DaubechiesBasis, level: int) -> Vector:
    """Inner products over the interval of the translates of ``level``, each normalised on the whole line."""
    order, end = basis.order, basis.units << level
    half_line = _half_line_products(order)
    translates = np.array(_translates(basis, level))

    def beyond(start: int) -> Vector:
        """Products over [start, infinity)."""
        k = translates - start
        products = np.eye(k.size)
        products[k <= 1 - 2 * order] = products[:, k <= 1 - 2 * order] = 0.0
        cut = np.flatnonzero((k < 0) & (k > 1 - 2 * order))
        products[np.ix_(cut, cut)] = half_line[np.ix_(k[cut], k[cut])]
        return products

    return beyond(0) - beyond(end)


@lru_cache
def _half_line_products(order: int) -> Vector:
    """The integral of phi(x - k) phi(x - l) over x > 0 at [k, l], for -(2 N - 2) <= k, l <= -1.

    By the two-scale relation these products are combinations of themselves and of the known ones.
    """
    taps = scaling_filter(order)
    cut = np.arange(2 - 2 * order, 0)
    reach = _taps_at(taps, np.arange(2 - 2 * order, 2 * order)[None, :] - 2 * cut[:, None])
    known = reach[:, cut.size :]
    matrix = 0.5 * np.kron(reach[:, : cut.size], reach[:, : cut.size])
    right = 0.5 * (known @ known.T).ravel()
    products = np.linalg.solve(np.eye(matrix.shape[0]) - matrix, right)
    return np.asarray(products.reshape(cut.size, cut.size), np.float64)
