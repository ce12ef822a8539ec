"""Typical magnitudes of the quantities of a problem, from its bounds, ends and guess."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.problem import Interval, OptimalControlProblem

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Scaling:
    """Positive magnitudes: of each state and control, of time, and of the objective."""

    states: Vector
    controls: Vector
    time: float
    objective: float


def automatic_scaling(problem: OptimalControlProblem) -> Scaling:
    """Take each magnitude from two-sided bounds, else from ends and guess; 1 where all of these are zero."""
    tau = np.linspace(0.0, 1.0, 33)
    states, controls = problem.guess.states_at(tau), problem.guess.controls_at(tau)
    return Scaling(
        states=np.array(
            [
                _magnitude(bounds, [*problem.initial_state[i], *problem.final_state[i], *states[i]])
                for i, bounds in enumerate(problem.state_bounds)
            ]
        ),
        controls=np.array(
            [_magnitude(bounds, list(controls[j])) for j, bounds in enumerate(problem.control_bounds)]
        ),
        time=max(abs(problem.guess.t0), abs(problem.guess.tf)) or 1.0,
        objective=1.0,
    )


def _magnitude(bounds: Interval, values: list[float]) -> float:
    if np.isfinite(bounds).all():
        return float(max(abs(bounds[0]), abs(bounds[1]))) or 1.0
    finite = [abs(value) for value in values if np.isfinite(value)]
    return float(max(finite, default=0.0)) or 1.0
