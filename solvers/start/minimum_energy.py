"""A start that obeys the model: the trajectory of least control energy between the ends.

A straight line between the ends seldom is a trajectory, and where it has no acceleration and no control, the
duration has no effect on the dynamics: the first step of an interior-point method then shortens a free
horizon until it meets its bound, and many iterations repair that.

A coordinate of a model of second order that a force of its own moves with least energy goes by a cubic
polynomial, which the positions and velocities at both ends give: that costs nothing. For a model of first
order the problem

    minimise the integral of sum_j (u_j / s_j)^2,   t0 and tf as guessed, no bounds but the ends,

is quadratic where the model is linear and takes a few iterations on a coarse mesh of splines. Bryson and Ho,
Applied Optimal Control, 1975, section 5.3; docs/benchmarks.md on what both save.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from solvers.bases.graded import GradedKnots
from solvers.expressions import named, parse, product, total
from solvers.formulation.quantities import FREE
from solvers.part import Part
from solvers.problem import OptimalControlProblem
from solvers.session import Account
from solvers.start.guess import WHOLE, Guess, Start, WarmStart
from solvers.start.scaling import Scaling
from solvers.transcription.spline_wavelet import SplineWavelet

Vector = NDArray[np.float64]

# Sixteen intervals; what is not found soon is not worth its time.
_LENGTH, _LEVEL = 8, 1
_TOLERANCE = 1e-4
_ITERATIONS = 12


@dataclass(frozen=True)
class CubicStart:
    """A guess in which the first ``coordinates`` states and their rates, the next ones, go by cubics."""

    guess: Guess
    coordinates: int

    @property
    def t0(self) -> float:
        """Initial time of the guess."""
        return self.guess.t0

    @property
    def tf(self) -> float:
        """Final time of the guess."""
        return self.guess.tf

    @property
    def design(self) -> Mapping[str, float]:
        """Design parameters of the guess."""
        return self.guess.design

    def states_at(self, tau: Vector) -> Vector:
        """See :class:`solvers.start.guess.Start`."""
        n, duration = self.coordinates, self.tf - self.t0
        ends = self.guess.states_at(WHOLE)
        cubics = CubicHermiteSpline(WHOLE, ends[:n].T, ends[n : 2 * n].T * duration)
        rest = self.guess.states_at(tau)[2 * n :]
        return np.vstack([cubics(tau).T, cubics(tau, 1).T / duration, rest])

    def controls_at(self, tau: Vector) -> Vector:
        """See :class:`solvers.start.guess.Start`."""
        return self.guess.controls_at(tau)


def minimum_energy_start(account: Account, part: Part) -> Start | None:
    """A trajectory of least control energy, to start from where the final time is free.

    None where the document says how states or controls go, where no control is bounded on both sides (then
    the straight line does as well), and where the trajectory is not found in a few iterations.
    """
    problem = part.problem
    bounded = any(np.isfinite(bounds).all() for bounds in problem.control_bounds)
    free = problem.final_time[0] < problem.final_time[1]
    if not (problem.guess.default and bounded and free):
        return None
    if problem.dynamics.coordinates:
        return CubicStart(problem.guess, problem.dynamics.coordinates)
    easier = _minimum_energy(problem, part.scaling)
    rough = account.aside(
        replace(part, problem=easier),
        tolerance=_TOLERANCE,
        max_iterations=_ITERATIONS,
        convergence=[],
        iterations=0,
    )
    knots = GradedKnots.uniform(_LENGTH, _LEVEL)
    transcription = SplineWavelet(easier, part.scaling, easier.guess, knots)
    solved = rough.solve_parts([transcription], "start", (0.0, 0.0))
    account.iterations += rough.iterations
    if not solved.converged:
        return None
    return WarmStart(solved.trajectory, problem.guess, problem.states, problem.controls)


def _minimum_energy(problem: OptimalControlProblem, scaling: Scaling) -> OptimalControlProblem:
    free = (FREE,) * len(problem.controls)
    scaled = [
        product(parse(float(1.0 / scale)), named(name))
        for name, scale in zip(problem.controls, scaling.controls, strict=True)
    ]
    return replace(
        problem,
        running_cost=total([product(control, control) for control in scaled]),
        terminal_cost=None,
        path=(),
        # What is said of integrals is not said of the ends.
        boundary=() if problem.integrals else problem.boundary,
        integrals=(),
        state_bounds=(FREE,) * len(problem.states),
        control_bounds=free,
        initial_control=free,
        final_control=free,
        initial_time=(problem.guess.t0, problem.guess.t0),
        final_time=(problem.guess.tf, problem.guess.tf),
        design=tuple(replace(item, interval=(item.guess, item.guess)) for item in problem.design),
    )
