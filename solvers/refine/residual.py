"""How far an answer is from the solution of its own differential equations, arc by arc, without integrating.

Between two breakpoints a curve x(t) leaves the residual r = f(x, u, t) - x'. The state that starts on the
curve at the left end leaves it by d with d' = f(x + d, u, t) - x'; two steps of Picard's iteration from d = 0
on the Gauss points of the arc give it to the second order in the residual, through the couplings of the
model. The control is clipped to its bounds, as it would be flown.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.bases.legendre import (
    gauss_barycentric_weights,
    lagrange_matrix,
    legendre_gauss,
)
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

SMALLEST_SCALE = 1e-6
_POINTS = 4


@dataclass(frozen=True)
class ArcErrors:
    """Errors on the K arcs between ``breaks`` (K + 1), relative to the scale of each quantity.

    ``states`` (n, K): largest distance of each state from the solution that starts at the left end of the
    arc; ``bounds`` (K,) and ``path`` (K,): largest violation of a bound and of a path constraint inside.
    """

    breaks: Vector
    states: Vector
    bounds: Vector
    path: Vector

    @property
    def worst(self) -> Vector:
        """The largest of them on each arc, (K,)."""
        return np.asarray(np.max([self.states.max(axis=0), self.bounds, self.path], axis=0), np.float64)


def arc_errors(problem: OptimalControlProblem, trajectory: Trajectory) -> ArcErrors:
    """Estimate the errors between the breakpoints of a trajectory; not finite where the model is not."""
    points, integral = _rule()
    breaks = trajectory.breakpoints
    widths = np.diff(breaks)
    tau = breaks[:-1, None] + widths[:, None] * points
    shape = (-1, *tau.shape)
    states, promised = trajectory.states_at(tau.ravel()), trajectory.rates_at(tau.ravel())
    controls = trajectory.controls_at(tau.ravel())
    limits = np.array(problem.control_bounds, np.float64).reshape(-1, 2)
    flown = np.clip(controls, limits[:, :1], limits[:, 1:])
    scale = _scale(states)
    drift = np.zeros_like(states).reshape(shape)
    with np.errstate(all="ignore"):
        for _ in range(2):
            scope = problem.scope(
                states + drift.reshape(states.shape), flown, trajectory.time(tau.ravel()), problem.parameters
            )
            rates = problem.dynamics.rate(scope, NUMPY)
            gap = np.array(np.broadcast_arrays(*rates, tau.ravel())[:-1]) - promised
            moved = trajectory.duration * widths[:, None] * (gap.reshape(shape) @ integral.T)
            drift = moved[..., :-1]
        errors = np.abs(moved).max(axis=-1) / scale[:, None]
        scope = problem.scope(states, flown, trajectory.time(tau.ravel()), problem.parameters)
        path = np.zeros(tau.size)
        for constraint in problem.path:
            values = np.broadcast_to(constraint.expression.evaluate(scope, NUMPY.functions), tau.size)
            path = np.maximum(path, _outside(values[None], np.array([constraint.interval])))
    bounds = np.maximum(
        _outside(states, np.array(problem.state_bounds, np.float64)),
        _outside(controls, limits) if controls.size else 0.0,
    )
    return ArcErrors(
        breaks, errors, bounds.reshape(tau.shape).max(axis=1), path.reshape(tau.shape).max(axis=1)
    )


def mesh_error_estimate(problem: OptimalControlProblem, trajectory: Trajectory) -> float | None:
    """The largest relative error of a state on an arc; None where the model has no finite rate."""
    largest = float(arc_errors(problem, trajectory).states.max())
    return largest if np.isfinite(largest) else None


def _outside(values: Vector, bounds: Vector) -> Vector:
    """The largest violation of bounds (R, 2) by rows of values (R, K), relative to each row's size, (K,)."""
    outside = np.maximum(bounds[:, :1] - values, values - bounds[:, 1:]) / _scale(values)[:, None]
    return np.asarray(np.maximum(outside, 0.0).max(axis=0), np.float64)


def _scale(values: Vector) -> Vector:
    return np.asarray(np.maximum(SMALLEST_SCALE, np.abs(values).max(axis=1)), np.float64)


@lru_cache(maxsize=1)
def _rule() -> tuple[Vector, Vector]:
    """Gauss points c (s,) in [0, 1] and the matrix (s + 1, s) to integrals from 0 to each of c and to 1."""
    nodes, _ = legendre_gauss(_POINTS)
    weights = gauss_barycentric_weights(_POINTS, initial_point=False)
    ends = np.append((nodes + 1.0) / 2.0, 1.0)
    rows = [
        shares @ lagrange_matrix(nodes, weights, end * (nodes + 1.0) - 1.0) * end / 2.0
        for end, (_, shares) in zip(ends, [legendre_gauss(_POINTS)] * ends.size, strict=True)
    ]
    return ends[:-1], np.array(rows)
