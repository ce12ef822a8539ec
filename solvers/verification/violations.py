"""Where a trajectory is looked at between its breakpoints, and how far quantities lie outside their bounds.

Violations are relative to each quantity's scale, its largest magnitude on the trajectory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.formulation.quantities import Constraint, Interval

Vector = NDArray[np.float64]

SMALLEST_SCALE = 1e-6
"""Quantities smaller than this are not looked at more closely."""

_SAMPLES_PER_ARC = 8


def dense(breakpoints: Vector) -> Vector:
    """The breakpoints and equally spaced points between them."""
    fractions = np.arange(_SAMPLES_PER_ARC) / _SAMPLES_PER_ARC
    return np.append((breakpoints[:-1, None] + np.diff(breakpoints)[:, None] * fractions).ravel(), 1.0)


def clipped(controls: Vector, bounds: Sequence[Interval] | Vector) -> Vector:
    """Controls (m, K) as they are flown, clipped to their bounds (m)."""
    limits = np.array(bounds, np.float64).reshape(-1, 2)
    return np.asarray(np.clip(controls, limits[:, :1], limits[:, 1:]), np.float64)


def scale_of(values: Vector) -> Vector:
    """The scale of each row: its largest magnitude, at least a smallest one."""
    scale: Vector = np.maximum(SMALLEST_SCALE, np.abs(values).max(axis=1, initial=0.0))
    return scale


def outside(values: Vector, bounds: Vector) -> Vector:
    """How far each of ``values`` (n, K) lies outside ``bounds`` (n, 2); NaN is infinitely far outside."""
    outside = np.maximum(bounds[:, :1] - values, values - bounds[:, 1:])
    return np.where(np.isnan(values), np.inf, np.maximum(outside, 0.0))


def scaled_violation(values: Vector, bounds: Vector, scale: Vector) -> float:
    """The largest violation of ``bounds`` (n, 2) by ``values`` (n, K), each row relative to its scale."""
    return float(np.max(outside(values, bounds.reshape(-1, 2)) / scale[:, None], initial=0.0))


def largest_violation(
    constraints: Sequence[Constraint], scope: Mapping[str, Any], tau: Vector | None = None
) -> float:
    """The largest violation of expressions, each relative to its own scale, where it is to hold."""
    largest = 0.0
    for constraint in constraints:
        with np.errstate(all="ignore"):
            value = constraint.expression.evaluate(scope, NUMPY.functions)
        if tau is not None:
            value = np.broadcast_to(value, tau.shape)[constraint.holds_at(tau)]
        values = np.atleast_2d(np.asarray(value, np.float64))
        size = np.max(np.abs(values), where=np.isfinite(values), initial=constraint.scale)
        scale = np.maximum(SMALLEST_SCALE, size)
        violation = scaled_violation(values, np.array([constraint.interval]), np.array([scale]))
        largest = max(largest, violation)
    return largest
