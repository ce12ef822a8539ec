"""What the costates say of an answer: the Hamiltonian along it.

H = L + lambda' f, minimised by the control; constant where neither the model, the running cost nor a path
constraint names the time, and then -1 for a minimum time, 0 where a free final time costs nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]


def hamiltonian(problem: OptimalControlProblem, trajectory: Trajectory, costates: Vector) -> Vector:
    """H at the nodes, (K,), from the costates there, (n, K)."""
    controls = trajectory.controls_at(trajectory.nodes)
    return np.asarray(_terms(problem, trajectory, controls, costates).sum(axis=0), np.float64)


def hamiltonian_drift(
    problem: OptimalControlProblem, trajectory: Trajectory, costates: Vector
) -> float | None:
    """How far H wanders from its median, relative to the largest sum of magnitudes of its terms.

    None where the problem names the time: H then has a reason to wander; and where H has no value.
    """
    if not problem.autonomous:
        return None
    terms = _terms(problem, trajectory, trajectory.controls_at(trajectory.nodes), costates)
    values, magnitude = terms.sum(axis=0), np.abs(terms).sum(axis=0).max()
    wander = np.max(np.abs(values - np.median(values)))
    if not np.isfinite(magnitude):
        return None
    return float(wander / magnitude) if magnitude > 0.0 else 0.0


def switching_functions(problem: OptimalControlProblem, trajectory: Trajectory, costates: Vector) -> Vector:
    """dH/du_j at the nodes, (m, K), by central differences: exact where H is linear in u."""
    controls = trajectory.controls_at(trajectory.nodes)
    values = []
    for index, bounds in enumerate(problem.control_bounds):
        width = bounds[1] - bounds[0]
        step = np.zeros_like(controls)
        step[index] = 1e-4 * (width if np.isfinite(width) else max(1.0, float(np.abs(controls[index]).max())))
        ahead, behind = (
            _terms(problem, trajectory, controls + side * step, costates).sum(axis=0) for side in (1.0, -1.0)
        )
        values.append((ahead - behind) / (2.0 * step[index]))
    return np.array(values).reshape(-1, controls.shape[1])


def _terms(
    problem: OptimalControlProblem, trajectory: Trajectory, controls: Vector, costates: Vector
) -> Vector:
    """The running cost and lambda_i f_i at the nodes under these controls, (n + 1, K)."""
    tau = trajectory.nodes
    times, parameters = trajectory.time(tau), problem.parameters_of(trajectory)
    scope = problem.scope(trajectory.states_at(tau), controls, times, parameters, NUMPY)
    with np.errstate(all="ignore"):  # the last iterate of a failed solve may have no finite rate
        rates = problem.dynamics.rate(scope, NUMPY)
        cost = 0.0 if problem.running_cost is None else problem.running_cost.evaluate(scope, NUMPY.functions)
        products = [costate * rate for costate, rate in zip(costates, rates, strict=True)]
    return np.array(np.broadcast_arrays(cost, *products, times)[:-1], np.float64)
