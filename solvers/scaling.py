"""Typical magnitudes of the quantities of a problem, from its bounds, ends and guess."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solvers.backends import NUMPY
from solvers.problem import OptimalControlProblem
from solvers.quantities import Interval

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Scaling:
    """Positive magnitudes of each state, control, design parameter and integral, of time and objective.

    ``equations`` (n,): the largest inertial term of each equation of motion when the coordinates move by
    their scales in the time of the guess; empty for models of first order.
    """

    states: Vector
    controls: Vector
    time: float
    objective: float
    design: Vector
    integrals: Vector
    equations: Vector

    @property
    def numbers(self) -> tuple[float, ...]:
        """All of them but those of the equations."""
        return (
            *self.states,
            *self.controls,
            self.time,
            self.objective,
            *self.design,
            *self.integrals,
        )


def automatic_scaling(problem: OptimalControlProblem) -> Scaling:
    """Take each magnitude from two-sided bounds, else from ends and guess; 1 where all of these are zero.

    Powers of two: they add no rounding, and problems that differ a little are scaled alike.
    """
    tau = np.linspace(0.0, 1.0, 33)
    states, controls = problem.guess.states_at(tau), problem.guess.controls_at(tau)
    scales = np.array(
        [
            _typical(bounds, [*problem.initial_state[i], *problem.final_state[i], *states[i]])
            for i, bounds in enumerate(problem.state_bounds)
        ]
    )
    return Scaling(
        states=scales,
        controls=np.array(
            [_typical(bounds, row) for bounds, row in zip(problem.control_bounds, controls, strict=True)]
        ),
        time=nearest_power_of_two(max(abs(problem.guess.t0), abs(problem.guess.tf))),
        objective=1.0,
        design=np.array([_typical(item.interval, [item.guess]) for item in problem.design]),
        integrals=np.array(
            [
                _typical(item.interval, [value])
                for item, value in zip(problem.integrals, problem.integrals_along(problem.guess), strict=True)
            ]
        ),
        equations=_inertial(problem, scales),
    )


def magnitude(interval: Interval) -> float:
    """A typical size of a quantity that is held within this interval; 1 where it tells none."""
    return nearest_power_of_two(max((abs(bound) for bound in interval if np.isfinite(bound)), default=0.0))


def nearest_power_of_two(size: float) -> float:
    """The power of two nearest to a positive size (by ratio), 1 for zero and what is not finite."""
    if not np.isfinite(size) or size <= 0.0:
        return 1.0
    return float(2.0 ** np.round(np.log2(size)))


def _typical(bounds: Interval, values: ArrayLike) -> float:
    if np.isfinite(bounds).all():
        return magnitude(bounds)
    sizes = np.abs(values)
    return nearest_power_of_two(float(np.max(sizes, where=np.isfinite(sizes), initial=0.0)))


def _inertial(problem: OptimalControlProblem, scales: Vector) -> Vector:
    n = problem.dynamics.coordinates
    guess, start = problem.guess, np.zeros(1)
    scope = problem.scope(
        guess.states_at(start)[:, 0],
        guess.controls_at(start)[:, 0],
        guess.t0,
        {**problem.parameters, **guess.design},
        NUMPY,
    )
    mass = np.array(problem.dynamics.mass(scope, NUMPY), np.float64).reshape(n, n)
    terms = np.abs(mass * scales[:n]).max(axis=1, initial=0.0) / (guess.tf - guess.t0) ** 2
    return np.array([nearest_power_of_two(size) for size in terms])
