"""What a control on a mesh gives away between the nodes: the gap in Pontryagin's principle.

Along an arc a feasible control u costs about the integral of H(x, u, lambda) - min H(x, v, lambda) over v
more than the best one. For a bounded control that enters linearly the minimum lies on a bound: where the mesh
puts a slope in the place of a switch, the gap is about the slope of the switching function times the square
of the step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.bases.legendre import composite_gauss
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.verification.violations import clipped

Vector = NDArray[np.float64]

_POINTS = 4


def suboptimality(problem: OptimalControlProblem, trajectory: Trajectory, costates: Vector) -> Vector:
    """The gap between the breakpoints, (K,), in units of the objective.

    ``costates`` (n, .) stand at the nodes of the trajectory, linear between them. Only the bounds of controls
    that have two are tried, one control after the other, so that the gap is never overestimated but by the
    costates; 0 without such controls.
    """
    breaks = trajectory.breakpoints
    tau, weights = composite_gauss(breaks, _POINTS)
    states, controls = trajectory.states_at(tau), trajectory.controls_at(tau)
    multipliers = np.array([np.interp(tau, trajectory.nodes, row) for row in costates])
    flown = clipped(controls, problem.control_bounds)

    def hamiltonian(u: Vector) -> Vector:
        scope = problem.scope(states, u, trajectory.time(tau), problem.parameters_of(trajectory), NUMPY)
        rates = problem.dynamics.rate(scope, NUMPY)
        cost = 0.0 if problem.running_cost is None else problem.running_cost.evaluate(scope, NUMPY.functions)
        terms = [costate * rate for costate, rate in zip(multipliers, rates, strict=True)]
        return np.broadcast_to(cost + sum(terms), tau.shape)

    gap = np.zeros(tau.size)
    with np.errstate(all="ignore"):
        here = hamiltonian(flown)
        for index, bounds in enumerate(problem.control_bounds):
            if np.isfinite(bounds).all():
                tried = [flown.copy() for _ in bounds]
                for control, bound in zip(tried, bounds, strict=True):
                    control[index] = bound
                lowest = np.minimum(*map(hamiltonian, tried))
                gap += np.maximum(np.nan_to_num(here - lowest), 0.0)
    per_arc = (weights * gap).reshape(-1, _POINTS).sum(axis=1)
    return np.asarray(trajectory.duration * per_arc, np.float64)
