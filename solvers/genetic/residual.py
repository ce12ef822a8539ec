"""How far an answer is from the end conditions of its problem."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from solvers.backends import NUMPY
from solvers.genetic.penalties import end_residuals
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Check
from solvers.verification.violations import SMALLEST_SCALE


def scale_of(trajectory: Trajectory) -> float:
    """The 2-norm of the largest magnitudes of the states."""
    states = trajectory.states_at(trajectory.breakpoints)
    return max(SMALLEST_SCALE, float(np.linalg.norm(np.abs(states).max(axis=1))))


def end_error(
    problem: OptimalControlProblem, trajectory: Trajectory, integrals: Mapping[str, float]
) -> float:
    """The 2-norm of the residuals of the end conditions; NaN where one has no value."""
    edges = np.array([0.0, 1.0])
    states, controls = trajectory.states_at(edges), trajectory.controls_at(edges)
    scope = problem.ends_scope(
        (states[:, 0], controls[:, 0], trajectory.t0),
        (states[:, 1], controls[:, 1], trajectory.tf),
        problem.parameters_of(trajectory),
        NUMPY,
        [integrals[item.name] for item in problem.integrals],
    )
    with np.errstate(all="ignore"):
        values = [float(item.evaluate(scope, NUMPY.functions)) for item in end_residuals(problem)]
    return float(np.linalg.norm(values))


def residual_check(residual: float, trajectory: Trajectory, limit: float) -> Check:
    """What is judged of ends that are penalised: their error (`end_error`) in parts of the states' scale."""
    return Check("residual", residual / scale_of(trajectory) if np.isfinite(residual) else None, limit)
