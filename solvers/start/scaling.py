"""Typical magnitudes of the quantities of a problem, from its bounds, ends and guess."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solvers.backends import NUMPY
from solvers.formulation.quantities import Interval
from solvers.problem import OptimalControlProblem

Vector = NDArray[np.float64]


# Below this a scale that comes from the ends is not believed.
_SMALL = 1.0 / 8.0
# Where nothing is said of a size it is taken for 1, unless the model says that this is off by more than this
# factor, as velocities and forces in SI units are.
_FAR = 1024.0


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

    Small ends say little of how far a state moves between them: such a state gets what the model can move it
    in the time of the guess, up to 1. Where nothing but zeros is said of a state or a control, the model
    decides whether 1 is a magnitude that it may have at all.

    Powers of two: they add no rounding, and problems that differ a little are scaled alike.
    """
    tau = np.linspace(0.0, 1.0, 33)
    states, controls = problem.guess.states_at(tau), problem.guess.controls_at(tau)
    ends = zip(problem.state_bounds, problem.initial_state, problem.final_state, states, strict=True)
    given = np.array([_typical(bounds, [*first, *last, *row]) for bounds, first, last, row in ends])
    control_scales = np.array(
        [_typical(bounds, row) for bounds, row in zip(problem.control_bounds, controls, strict=True)]
    )
    scales = _within_reach(problem, given, control_scales)
    control_scales = _moving(problem, scales, control_scales)
    return Scaling(
        states=scales,
        controls=control_scales,
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


def end_scales(problem: OptimalControlProblem, scaling: Scaling, speed: float) -> Vector:
    """Magnitudes of the states (n,) by which misses of ends are compared.

    That of a velocity is ``speed`` times the mean speed at which its coordinate moves by its magnitude in the
    time of the guess.
    """
    scale = scaling.states.copy()
    n, guess = problem.dynamics.coordinates, problem.guess
    scale[n : 2 * n] = speed * scale[:n] / (guess.tf - guess.t0)
    return scale


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


def _within_reach(problem: OptimalControlProblem, scales: Vector, controls: Vector) -> Vector:
    """Raise small scales of states without two-sided bounds to what the model can move them, up to 1."""
    bounded = np.isfinite(problem.state_bounds).all(axis=1)
    unsure = (scales < _SMALL) & ~bounded
    guess, tau = problem.guess, np.array([0.0, 0.5, 1.0])
    unknown = ~bounded & ~np.any(guess.states_at(tau), axis=1)
    if not (unsure | unknown).any():
        return scales
    states = np.tile(guess.states_at(tau), 2)
    bounds = np.array(problem.control_bounds, np.float64).reshape(-1, 2)
    middle = guess.controls_at(tau)
    extremes = np.hstack(
        [
            np.where(np.isfinite(side[:, None]), side[:, None], middle + sign * controls[:, None])
            for side, sign in ((bounds[:, 0], -1.0), (bounds[:, 1], 1.0))
        ]
    )
    times = np.tile(guess.t0 + (guess.tf - guess.t0) * tau, 2)
    parameters = {**problem.parameters, **guess.design}
    # Twice: what a velocity can reach moves a position.
    for shift in (0.0, 1.0):
        with np.errstate(all="ignore"):
            rates = problem.rate(states + shift * scales[:, None], extremes, times, parameters, NUMPY)
        reach = (guess.tf - guess.t0) * np.array([np.max(np.abs(rate)) for rate in rates])
        reach = np.nan_to_num(reach, posinf=0.0)
        floor = np.where(unknown & (reach > _FAR), reach, np.where(unsure, np.minimum(1.0, reach), 0.0))
        scales = np.maximum(
            scales, np.where(floor > 0.0, [nearest_power_of_two(size) for size in floor], 0.0)
        )
    return scales


def _moving(problem: OptimalControlProblem, states: Vector, controls: Vector) -> Vector:
    """Controls of which nothing is said: as much as moves a state by its scale in the time of the guess.

    Where the model by itself moves states by far more in that time, what a control does is over long before.
    """
    guess, middle, found = problem.guess, np.array([0.5]), controls.copy()
    levels = guess.controls_at(middle)
    bounded = np.isfinite(np.array(problem.control_bounds, np.float64).reshape(-1, 2)).all(axis=1)
    for index in np.flatnonzero(~bounded & ~levels[:, 0].astype(bool)):
        moved = np.repeat(levels, 2, axis=1)
        moved[index] = controls[index] * np.array([1.0, -1.0])
        parameters, time = {**problem.parameters, **guess.design}, guess.t0 + 0.5 * (guess.tf - guess.t0)
        at, times = np.repeat(guess.states_at(middle), 2, axis=1), np.full(2, time)
        with np.errstate(all="ignore"):
            aside = at + states[:, None] * np.array([1.0, -1.0])
            own = problem.rate(aside, np.repeat(levels, 2, axis=1), times, parameters, NUMPY)
            drift = [np.max(np.abs(rate)) * (guess.tf - guess.t0) for rate in own]
            if np.any(np.array(drift) > _FAR * states):
                continue
            rates = problem.rate(at, moved, times, parameters, NUMPY)
            slopes = np.array([np.ptp(np.broadcast_to(rate, 2)) for rate in rates]) / (2.0 * controls[index])
            most = float(np.max(np.nan_to_num(slopes * (guess.tf - guess.t0) / states, posinf=0.0)))
        if most > 0.0 and not 1.0 / _FAR <= most * controls[index] <= _FAR:
            found[index] = nearest_power_of_two(1.0 / most)
    return found


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
