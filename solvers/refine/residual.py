"""How far an answer is from the solution of its own differential equations, arc by arc, without integrating.

Between two breakpoints a curve x(t) leaves the residual r = f(x, u, t) - x'. The state that starts on the
curve at the left end leaves it by d with d' = f(x + d, u, t) - x'; two steps of Picard's iteration from d = 0
on the Gauss points of the arc give it to the second order in the length of the arc. Where these do not
settle the arc is long for the model, and an implicit rule follows the drift. The control is clipped to its
bounds, as it would be flown.
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
from solvers.verification.verify import MEANINGFUL_GROWTH
from solvers.verification.violations import clipped, dense, outside, scale_of

Vector = NDArray[np.float64]

_POINTS = 5
# Picard's second step may change the first by this part of the drift, or by so little, else the arc is long.
_CONTRACTS = 0.5
_NEGLIGIBLE = 1e-3
_STEPS = 16


@dataclass(frozen=True)
class ArcErrors:
    """Errors on the K arcs between ``breaks`` (K + 1), relative to the scale of each quantity.

    ``states`` (n, K): largest distance of each state from the solution that starts at the left end of the
    arc; ``ends`` (n, K): that distance at the right end, with its sign; ``bounds`` (K,) and ``path`` (K,):
    largest violation of a bound and of a path constraint inside.
    """

    states: Vector
    ends: Vector
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
    gap_with = _Gap(problem, trajectory, tau.ravel())
    scale = scale_of(gap_with.states)
    drift = np.zeros((scale.size, tau.size))
    moves = []
    with np.errstate(all="ignore"):
        for _ in range(2):
            gap = gap_with(drift).reshape(shape)
            moves.append(trajectory.duration * widths[:, None] * (gap @ integral.T) / scale[:, None, None])
            drift = (moves[-1][..., :-1] * scale[:, None, None]).reshape(drift.shape)
        largest, ends = np.abs(moves[1]).max(axis=-1), moves[1][..., -1]
        change = np.abs(moves[1] - moves[0]).max(axis=(0, 2))
        long = ~(change <= np.maximum(_CONTRACTS * largest.max(axis=0), _NEGLIGIBLE))
        if long.any():
            largest[:, long], ends[:, long] = _followed(problem, trajectory, np.flatnonzero(long), scale)
        return ArcErrors(largest, ends, *_violations(problem, trajectory))


def _violations(problem: OptimalControlProblem, trajectory: Trajectory) -> tuple[Vector, Vector]:
    """The largest violation of a bound and of a path constraint on each arc, where verification looks."""
    tau = dense(trajectory.breakpoints)
    states, controls, limits = (
        trajectory.states_at(tau),
        trajectory.controls_at(tau),
        _control_limits(problem),
    )
    bounds, path = _outside(states, np.array(problem.state_bounds, np.float64)), np.zeros(tau.size)
    if controls.size:
        bounds = np.maximum(bounds, _outside(controls, limits))
    flown = clipped(controls, problem.control_bounds)
    scope = problem.scope(states, flown, trajectory.time(tau), problem.parameters_of(trajectory), NUMPY)
    for constraint in problem.path:
        values = np.broadcast_to(constraint.expression.evaluate(scope, NUMPY.functions), tau.size)
        beyond = _outside(values[None], np.array([constraint.interval]))
        path = np.maximum(path, np.where(constraint.holds_at(tau), beyond, 0.0))
    # An arc has its own samples and the first one of the next.
    starts = np.arange(0, tau.size - 1, (tau.size - 1) // (trajectory.breakpoints.size - 1))
    first, second = (
        np.maximum(np.maximum.reduceat(values[:-1], starts), values[np.append(starts[1:], tau.size - 1)])
        for values in (bounds, path)
    )
    return first, second


def mesh_error_estimate(problem: OptimalControlProblem, trajectory: Trajectory) -> float | None:
    """The largest relative error of a state on an arc; None where the model has no finite rate."""
    largest = float(arc_errors(problem, trajectory).states.max())
    return largest if np.isfinite(largest) else None


def flight_errors(
    problem: OptimalControlProblem, trajectory: Trajectory, errors: ArcErrors, begin: Vector | None = None
) -> Vector | None:
    """The errors (n,) of states at the end of the flight over all arcs, to first order in those of the arcs.

    Relative to scales, as are those of the ``begin``, by default none. None where they are meaningless:
    errors grow beyond measure on the way.
    """
    breaks = trajectory.breakpoints
    widths = np.diff(breaks)
    scale = scale_of(trajectory.states_at(breaks))
    n = scale.size
    with np.errstate(all="ignore"):
        gap = _Gap(problem, trajectory, (breaks[1:] + breaks[:-1]) / 2.0)
        slopes = _slopes(gap, np.zeros((n, widths.size)), scale)
    if not np.isfinite(slopes).all():
        return None
    half = slopes * (trajectory.duration * widths / 2.0)[:, None, None]
    unit = np.eye(n)
    transitions = np.linalg.solve(unit - half, unit + half)
    error, to_end = np.zeros(n), unit
    for transition, miss in zip(transitions[::-1], errors.ends.T[::-1], strict=True):
        error = error + to_end @ miss
        to_end = to_end @ transition
        if not np.max(np.abs(to_end)) < MEANINGFUL_GROWTH:
            return None
    return error if begin is None else error + to_end @ begin


class _Gap:
    """f(x + d, u, t) - x' for drifts d (n, K) at K normalised times, with the control as flown."""

    def __init__(self, problem: OptimalControlProblem, trajectory: Trajectory, tau: Vector) -> None:
        self._problem = problem
        self._controls = clipped(trajectory.controls_at(tau), problem.control_bounds)
        self._time = trajectory.time(tau)
        self._parameters = problem.parameters_of(trajectory)
        self._slopes = trajectory.rates_at(tau)
        self.states = trajectory.states_at(tau)

    def __call__(self, drift: Vector) -> Vector:
        rates = self._problem.rate(self.states + drift, self._controls, self._time, self._parameters, NUMPY)
        return np.array(np.broadcast_arrays(*rates, self._time)[:-1]) - self._slopes


def _slopes(gap: _Gap, drift: Vector, scale: Vector) -> Vector:
    """df/dx at K points x + d by central differences, in scaled states, (K, n, n)."""
    columns = []
    for index, size in enumerate(scale):
        step = np.zeros((scale.size, 1))
        step[index] = 1e-6 * size
        columns.append((gap(drift + step) - gap(drift - step)) / (2e-6 * scale[:, None]))
    return np.moveaxis(np.array(columns), -1, 0).swapaxes(1, 2)


def _followed(
    problem: OptimalControlProblem, trajectory: Trajectory, arcs: NDArray[np.intp], scale: Vector
) -> tuple[Vector, Vector]:
    """Largest drift and that at the end, (n, K), of arcs that are long for the model, where Picard diverges.

    By the linearly implicit Euler rule, which stays near a stable motion however long its steps are.
    """
    left, width = trajectory.breakpoints[arcs], np.diff(trajectory.breakpoints)[arcs]
    step = trajectory.duration * width / _STEPS
    drift = largest = np.zeros((scale.size, arcs.size))
    unit = np.eye(scale.size)
    for index in range(_STEPS):
        tau = left + width * (index + 0.5) / _STEPS
        gap_with = _Gap(problem, trajectory, tau)
        slopes = np.nan_to_num(_slopes(gap_with, drift, scale), posinf=0.0, neginf=0.0)
        gap = gap_with(drift) / scale[:, None]
        system = unit - step[:, None, None] * slopes
        drift = drift + scale[:, None] * np.linalg.solve(system, (step * gap).T[..., None])[..., 0].T
        largest = np.maximum(largest, np.abs(drift / scale[:, None]))
    return largest, drift / scale[:, None]


def _control_limits(problem: OptimalControlProblem) -> Vector:
    return np.array(problem.control_bounds, np.float64).reshape(-1, 2)


def _outside(values: Vector, bounds: Vector) -> Vector:
    """The largest violation of bounds (R, 2) by rows of values (R, K), relative to each row's size, (K,)."""
    return np.asarray((outside(values, bounds) / scale_of(values)[:, None]).max(axis=0), np.float64)


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
