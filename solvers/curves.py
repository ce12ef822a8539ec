"""Functions of normalised time tau in [0, 1]: what a method returns for each state and control."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PPoly

from solvers.bases.cubic_spline import CubicSplineSpace
from solvers.bases.daubechies import DaubechiesBasis
from solvers.bases.hermite import cubic_pieces, quadratic_pieces
from solvers.bases.legendre import barycentric_weights, differentiation_matrix, lagrange_matrix

Vector = NDArray[np.float64]

# Matrices of up to so many numbers are kept for the next curve.
_LARGEST_KEPT = 200_000


class Curve(Protocol):
    """A scalar function of tau in [0, 1]."""

    def __call__(self, tau: Vector, derivative: int = 0) -> Vector:
        """Values, or the ``derivative``-th derivative with respect to tau, shape of ``tau``."""
        ...


@dataclass(frozen=True)
class SplineCurve:
    """A cubic C2 spline by its B-spline coefficients."""

    space: CubicSplineSpace
    coefficients: Vector

    def __call__(self, tau: Vector, derivative: int = 0) -> Vector:
        """See :class:`Curve`."""
        return self.space.evaluate(self.coefficients, tau, derivative)


@dataclass(frozen=True)
class DerivativeCurve:
    """The derivative of another curve, times ``factor``."""

    curve: Curve
    factor: float

    def __call__(self, tau: Vector, derivative: int = 0) -> Vector:
        """See :class:`Curve`."""
        return self.factor * self.curve(tau, derivative + 1)


@dataclass(frozen=True)
class HermiteCurve:
    """A piecewise cubic by values and slopes (with respect to tau) at knots."""

    knots: Vector
    values: Vector
    slopes: Vector

    def __call__(self, tau: Vector, derivative: int = 0) -> Vector:
        """See :class:`Curve`."""
        return np.asarray(self._pieces(tau, derivative), np.float64)

    @cached_property
    def _pieces(self) -> CubicHermiteSpline:
        return cubic_pieces(self.knots, self.values, self.slopes)


@dataclass(frozen=True)
class LinearCurve:
    """Straight lines between values at points that ascend from 0 to 1."""

    points: Vector
    values: Vector

    def __call__(self, tau: Vector, derivative: int = 0) -> Vector:
        """See :class:`Curve`."""
        if derivative == 0:
            return np.interp(tau, self.points, self.values)
        piece = np.clip(np.searchsorted(self.points, tau, side="right") - 1, 0, self.points.size - 2)
        slopes = np.diff(self.values) / np.diff(self.points)
        return slopes[piece] if derivative == 1 else np.zeros_like(tau)


@dataclass(frozen=True)
class StepCurve:
    """``values`` (K,), each held from one of the ``edges`` (K + 1, from 0 to 1) to the next."""

    edges: Vector
    values: Vector

    def __call__(self, tau: Vector, derivative: int = 0) -> Vector:
        """See :class:`Curve`."""
        if derivative:
            return np.zeros_like(tau)
        piece = np.clip(np.searchsorted(self.edges, tau, side="right") - 1, 0, self.values.size - 1)
        return np.asarray(self.values[piece], np.float64)


@dataclass(frozen=True)
class QuadraticCurve:
    """A continuous piecewise quadratic by values at the knots and the midpoints between them."""

    knots: Vector
    values: Vector

    def __call__(self, tau: Vector, derivative: int = 0) -> Vector:
        """See :class:`Curve`."""
        return np.asarray(self._pieces(tau, derivative), np.float64)

    @cached_property
    def _pieces(self) -> PPoly[np.float64]:
        triples = np.column_stack([self.values[:-2:2], self.values[1::2], self.values[2::2]])
        return quadratic_pieces(self.knots, triples)


@dataclass(frozen=True)
class DaubechiesCurve:
    """A combination of Daubechies' functions, tabulated as parabolas on the dyadic intervals of ``level``.

    Exact at the ends of these intervals, and in its integral over each.
    """

    basis: DaubechiesBasis
    level: int
    coefficients: Vector

    def __call__(self, tau: Vector, derivative: int = 0) -> Vector:
        """See :class:`Curve`."""
        return self._parabolas(tau, derivative)

    @cached_property
    def _parabolas(self) -> QuadraticCurve:
        return QuadraticCurve(
            self.basis.points(self.level), self.coefficients @ self.basis.parabolas(self.level)
        )


@dataclass(frozen=True)
class LagrangeCurve:
    """A polynomial on each segment, by its values at support points.

    ``breaks``: ends of the S segments, from 0 to 1; ``supports``: for each segment its points in [-1, 1];
    ``values``: for each segment the values there.
    """

    breaks: Vector
    supports: tuple[Vector, ...]
    values: tuple[Vector, ...]

    def __call__(self, tau: Vector, derivative: int = 0) -> Vector:
        """See :class:`Curve`; at an inner break the segment on the right speaks."""
        widths, result = np.diff(self.breaks), np.empty_like(tau)
        located = _located if tau.size <= _LARGEST_KEPT else _located.__wrapped__
        places = located(self.breaks.tobytes(), self._groups.tobytes(), tau.tobytes())
        for alike, (here, own, local) in zip(self._alike, places, strict=True):
            if alike.constant:
                result[here] = 0.0 if derivative else alike.values[own, 0]
                continue
            rows = _interpolation(alike.support, local)
            result[here] = np.einsum("ij,ij->i", rows, alike.derivative(derivative, widths)[own])
        return result

    @property
    def rests(self) -> bool:
        """Whether it is constant on every segment."""
        return all(alike.constant for alike in self._alike)

    @cached_property
    def _groups(self) -> NDArray[np.intp]:
        """For each segment, which group of alike ones it belongs to."""
        groups = np.zeros(len(self.supports), np.intp)
        for index, alike in enumerate(self._alike):
            groups[alike.segments] = index
        return groups

    @cached_property
    def _alike(self) -> list[_Alike]:
        sizes = np.array([support.size for support in self.supports])
        groups = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
        return [
            _Alike(group, self.supports[group[0]], np.array([self.values[index] for index in group]))
            for group in groups
        ]


def at_the_same_nodes(first: Curve, second: Curve, function: Callable[[Vector, Vector], Vector]) -> Curve:
    """The curve of the same kind that goes through what ``function`` makes of two curves at their nodes.

    Both are of one mesh. Raises TypeError for curves that are not given by values at nodes.
    """
    if isinstance(first, LagrangeCurve) and isinstance(second, LagrangeCurve):
        return replace(first, values=tuple(map(function, first.values, second.values)))
    if isinstance(first, LinearCurve | QuadraticCurve) and isinstance(second, LinearCurve | QuadraticCurve):
        return replace(first, values=function(first.values, second.values))
    raise TypeError(f"{type(first).__name__} and {type(second).__name__} have no values at common nodes")


def values_of(curve: Curve) -> Vector:
    """All values of a curve in their order; raises TypeError for one that is not given by values at nodes."""
    if isinstance(curve, LagrangeCurve):
        return np.concatenate(curve.values)
    if isinstance(curve, LinearCurve | QuadraticCurve):
        return curve.values
    raise TypeError(f"{type(curve).__name__} has no values at nodes")


def through(curve: Curve, function: Callable[[Vector], Vector]) -> Curve:
    """The curve of the same kind that goes through what ``function`` makes of all its values, in order.

    Raises TypeError for a curve that is not given by values at nodes.
    """
    values = function(values_of(curve))
    if isinstance(curve, LagrangeCurve):
        ends = np.cumsum([own.size for own in curve.values])[:-1]
        return replace(curve, values=tuple(np.split(values, ends)))
    assert isinstance(curve, LinearCurve | QuadraticCurve)
    return replace(curve, values=values)


def by_nodes(curve: Curve, points: Vector) -> Curve:
    """The curve, or straight lines between its values at ``points`` where no values at nodes make it up."""
    known = isinstance(curve, LagrangeCurve | LinearCurve | QuadraticCurve)
    return curve if known else LinearCurve(points, curve(points))


def rests_between_breaks(curve: Curve) -> bool:
    """Whether a curve is known to be constant between its breaks."""
    if isinstance(curve, LagrangeCurve):
        return curve.rests
    return isinstance(curve, StepCurve)


def _interpolation(support: Vector, local: Vector) -> Vector:
    """Rows from values at the support to those at local points: the same for all states of a trajectory."""
    if support.size * local.size > _LARGEST_KEPT:
        return lagrange_matrix(support, _weights(support.tobytes()), local)
    return _kept_interpolation(support.tobytes(), local.tobytes())


@lru_cache(maxsize=16)
def _located(
    breaks: bytes, groups: bytes, tau: bytes
) -> list[tuple[NDArray[np.intp], NDArray[np.intp], Vector]]:
    """For each group of segments, which of the places are in it, their segments among its, and where there.

    Kept, as for the interpolation: all states of a trajectory are asked at the same places.
    """
    edges, group, places = np.frombuffer(breaks), np.frombuffer(groups, np.intp), np.frombuffer(tau)
    segment = np.clip(np.searchsorted(edges, places, side="right") - 1, 0, edges.size - 2)
    local = 2.0 * (places - edges[segment]) / np.diff(edges)[segment] - 1.0
    found = []
    for index in range(group.max() + 1):
        here = np.flatnonzero(group[segment] == index)
        own = np.searchsorted(np.flatnonzero(group == index), segment[here])
        found.append((here, own, local[here]))
    return found


@lru_cache(maxsize=16)
def _kept_interpolation(support: bytes, local: bytes) -> Vector:
    return lagrange_matrix(np.frombuffer(support), _weights(support), np.frombuffer(local))


@lru_cache(maxsize=16)
def _differentiation(support: bytes) -> Vector:
    return differentiation_matrix(np.frombuffer(support), _weights(support))


@lru_cache(maxsize=64)
def _weights(support: bytes) -> Vector:
    return barycentric_weights(np.frombuffer(support))


@dataclass(frozen=True)
class _Alike:
    """Segments (ascending indices) with the same support, their values (segments x support)."""

    segments: NDArray[np.intp]
    support: Vector
    values: Vector

    @cached_property
    def constant(self) -> bool:
        """Whether the values are the same along every segment, as those of a control on its bounds."""
        return bool((self.values == self.values[:, :1]).all())

    def derivative(self, order: int, widths: Vector) -> Vector:
        """Values of the derivative with respect to tau at the support."""
        values = self.values
        if order:
            slopes = _differentiation(self.support.tobytes())
            for _ in range(order):
                values = (values @ slopes.T) * (2.0 / widths[self.segments])[:, None]
        return values
