"""Bang-bang controls flown side by side, the lengths of their arcs moved until they reach the target.

Levenberg's and Marquardt's method on the final states over the lengths of the arcs, all flights at once: a
step of Runge and Kutta's method takes as long for a hundred flights as for one. Rough on purpose: what comes
close is solved exactly elsewhere.

Source: D. W. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, J. SIAM 11, 1963.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from solvers.arrays.rates import Rates
from solvers.curves import HermiteCurve, StepCurve
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.verification.violations import SMALLEST_SCALE

Vector = NDArray[np.float64]

_STEPS_PER_ARC = 10
_ITERATIONS = 25
# Relative: how near the ends a flight must come, and how far a length is moved for its derivative.
_NEAR = 1e-3
_MOVED = 1e-5
_DAMPING = 1e-2
_SMALLEST_DAMPING = 1e-8


class BangBangFlights:
    """Controls with ``levels`` (F, m, S) on the S arcs of F flights, which begin where ``near`` does."""

    def __init__(self, problem: OptimalControlProblem, near: Trajectory, levels: Vector) -> None:
        self._problem, self._near, self._levels = problem, near, levels
        self._rates = Rates(problem, problem.parameters_of(near), [])
        tau = near.breakpoints
        self._scale = np.maximum(SMALLEST_SCALE, np.abs(near.states_at(tau)).max(axis=1))
        self._start = near.states_at(np.zeros(1))[:, 0]
        target = np.array(problem.final_state)
        self._held = target[:, 0] == target[:, 1]
        self._target = target[self._held, 0]

    def to_target(self, lengths: Vector, stop: Callable[[], bool]) -> Vector:
        """Where the lengths (F, S) of the arcs lead; NaN for flights that do not come near the target.

        ``stop`` is asked between iterations: then flights are as near as they have come.
        """
        flights, arcs = lengths.shape
        damping = np.full(flights, _DAMPING)
        miss = self._miss(lengths[:, None, :])[:, 0]
        for _ in range(_ITERATIONS):
            if stop():
                break
            step = _MOVED * np.maximum(lengths.sum(axis=1), self._near.duration)
            moved = lengths[:, None, :] + step[:, None, None] * np.eye(arcs)
            slopes = (self._miss(moved) - miss[:, None]).swapaxes(1, 2) / step[:, None, None]
            slopes = np.nan_to_num(slopes, posinf=0.0, neginf=0.0)
            normal = slopes.swapaxes(1, 2) @ slopes
            size = np.trace(normal, axis1=1, axis2=2) / arcs + np.finfo(float).tiny
            damped = normal + (damping * size)[:, None, None] * np.eye(arcs)
            gradient = slopes.swapaxes(1, 2) @ np.nan_to_num(miss)[:, :, None]
            tried = np.maximum(lengths - np.linalg.solve(damped, gradient)[:, :, 0], 0.0)
            found = self._miss(tried[:, None, :])[:, 0]
            better = _size(found) < _size(miss)
            lengths = np.where(better[:, None], tried, lengths)
            miss = np.where(better[:, None], found, miss)
            damping = np.where(better, np.maximum(damping / 10.0, _SMALLEST_DAMPING), damping * 10.0)
        return np.where((_size(miss) <= _NEAR)[:, None], lengths, np.nan)

    def trajectory(self, index: int, lengths: Vector) -> Trajectory:
        """One of the flights, with these lengths (S,) of its arcs."""
        levels, problem = self._levels[index], self._problem
        states, slopes = self._fly(lengths[None, :], levels[None])
        ends = np.append(0.0, np.cumsum(lengths))
        parts = np.arange(_STEPS_PER_ARC) / _STEPS_PER_ARC
        times = np.append((ends[:-1, None] + lengths[:, None] * parts).ravel(), ends[-1])
        tau = times / ends[-1]
        return Trajectory(
            t0=self._near.t0,
            tf=self._near.t0 + float(ends[-1]),
            states={
                name: HermiteCurve(tau, x, ends[-1] * rate)
                for name, x, rate in zip(problem.states, states[:, :, 0].T, slopes[:, :, 0].T, strict=True)
            },
            controls={
                name: StepCurve(ends / ends[-1], row)
                for name, row in zip(problem.controls, levels, strict=True)
            },
            interpolation="previous",
            basis={},
            breakpoints=tau,
            nodes=tau,
            design=self._near.design,
        )

    def _miss(self, lengths: Vector) -> Vector:
        """How far lengths (F, V, S) of arcs miss the target, (F, V, held states), relative to scales."""
        flights, variants, arcs = lengths.shape
        levels = np.repeat(self._levels, variants, axis=0)
        states, _ = self._fly(lengths.reshape(-1, arcs), levels)
        missed = (states[-1][self._held] - self._target[:, None]) / self._scale[self._held][:, None]
        return np.asarray(missed.T.reshape(flights, variants, -1), np.float64)

    def _fly(self, lengths: Vector, levels: Vector) -> tuple[Vector, Vector]:
        """States and rates, each (steps + 1, n, K), of K flights with ``lengths`` (K, S)."""
        count, arcs = lengths.shape
        state, time = np.tile(self._start[:, None], count), np.full(count, self._near.t0)
        states, slopes = [state], []
        with np.errstate(all="ignore"):
            for arc in range(arcs):
                control, h = levels[:, :, arc].T, lengths[:, arc] / _STEPS_PER_ARC
                for _ in range(_STEPS_PER_ARC):
                    first = self._rates(state, control, time)
                    second = self._rates(state + h / 2.0 * first, control, time + h / 2.0)
                    third = self._rates(state + h / 2.0 * second, control, time + h / 2.0)
                    last = self._rates(state + h * third, control, time + h)
                    state, time = state + h / 6.0 * (first + 2.0 * (second + third) + last), time + h
                    states.append(state)
                    slopes.append(first)
            slopes.append(self._rates(state, levels[:, :, -1].T, time))
        return np.array(states), np.array(slopes)


def _size(miss: Vector) -> Vector:
    """The largest miss of each flight; infinite where it is not a number."""
    largest: Vector = np.abs(miss).max(axis=1, initial=0.0)
    return np.where(np.isnan(largest), np.inf, largest)
