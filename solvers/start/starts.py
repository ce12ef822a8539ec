"""Other places to start from: what finds other local optima.

The first start is the guess of the document; the others differ from it by a smooth wave in every state, which
leaves the ends that are given alone, by controls that wander between their bounds, and by a longer or shorter
horizon. They are the same every time: the numbers come from a Halton sequence (Halton 1960), a point a start.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from solvers.problem import OptimalControlProblem
from solvers.start.guess import Start
from solvers.start.scaling import Scaling

Vector = NDArray[np.float64]

_WAVES = 3
_SHAPES = _WAVES + 2
_CONTROL_KNOTS = 6
# Of each state's scale.
_WAVE_SIZE = 1.0
_MOVED = 0.25


@dataclass(frozen=True)
class PerturbedStart:
    """A start beside another one; times are already within their bounds.

    ``waves`` (n, 5): amplitudes of sin(pi k tau), k = 1..3, of tau and of 1 - tau, added to the states;
    ``controls`` (m, 6): values at equally spaced knots, in their bounds.
    """

    base: Start
    t0: float
    tf: float
    waves: Vector
    controls: Vector

    @property
    def design(self) -> Mapping[str, float]:
        """Those of the other start."""
        return self.base.design

    def states_at(self, tau: Vector) -> Vector:
        """See :class:`solvers.start.guess.Start`."""
        waves = np.sin(np.pi * np.arange(1, _WAVES + 1)[:, None] * tau)
        added: Vector = self.waves @ np.vstack([waves, tau, 1.0 - tau])
        return self.base.states_at(tau) + added

    def controls_at(self, tau: Vector) -> Vector:
        """See :class:`solvers.start.guess.Start`."""
        knots = np.linspace(0.0, 1.0, _CONTROL_KNOTS)
        return np.array([np.interp(tau, knots, row) for row in self.controls]).reshape(-1, tau.size)


def several_starts(problem: OptimalControlProblem, scaling: Scaling, count: int) -> list[Start]:
    """The guess of the problem and ``count`` - 1 starts beside it."""
    if count == 1:
        return [problem.guess]
    n, m = len(problem.states), len(problem.controls)
    # A Halton sequence without scrambling begins at a corner of the cube: leave that point out.
    points = qmc.Halton(1 + _SHAPES * n + _CONTROL_KNOTS * m, scramble=False).random(count)[1:]
    return [problem.guess, *(_perturbed(problem, scaling, point, n, m) for point in points)]


def moved_start(problem: OptimalControlProblem, scaling: Scaling) -> Start:
    """The guess with every control a part of its scale off: from where it is, an expression has no slope.

    So it is with roots and magnitudes at 0, where controls begin of which nothing is said.
    """
    guess = problem.guess
    bounds = np.array(problem.control_bounds, np.float64).reshape(-1, 2)
    middle = guess.controls_at(np.full(_CONTROL_KNOTS, 0.5))
    moved = np.clip(middle + _MOVED * scaling.controls[:, None], bounds[:, :1], bounds[:, 1:])
    return PerturbedStart(guess, guess.t0, guess.tf, np.zeros((len(problem.states), _SHAPES)), moved)


def _perturbed(
    problem: OptimalControlProblem, scaling: Scaling, point: Vector, n: int, m: int
) -> PerturbedStart:
    guess = problem.guess
    horizon, waves, controls = np.split(point, [1, 1 + _SHAPES * n])
    duration = (guess.tf - guess.t0) * 2.0 ** (2.0 * horizon[0] - 1.0)
    bounds = np.array(problem.control_bounds, np.float64).reshape(-1, 2)
    middle = guess.controls_at(np.array([0.5]))
    lower = np.where(np.isfinite(bounds[:, :1]), bounds[:, :1], middle - scaling.controls[:, None])
    upper = np.where(np.isfinite(bounds[:, 1:]), bounds[:, 1:], middle + scaling.controls[:, None])
    amplitudes = _WAVE_SIZE * scaling.states[:, None] * (2.0 * waves.reshape(n, _SHAPES) - 1.0)
    for column, ends in ((-2, problem.final_state), (-1, problem.initial_state)):
        amplitudes[[end[0] == end[1] for end in ends], column] = 0.0
    return PerturbedStart(
        guess,
        guess.t0,
        float(np.clip(guess.t0 + duration, *problem.final_time)),
        amplitudes,
        lower + (upper - lower) * controls.reshape(m, _CONTROL_KNOTS),
    )
