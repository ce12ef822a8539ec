"""Costates of models of second order, from the multipliers of their equations of motion."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from solvers.bases.cubic_spline import CubicSplineSpace
from solvers.problem import OptimalControlProblem
from solvers.symbolic import CASADI
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]


def second_order_costates(
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    multipliers: Vector,
    space: CubicSplineSpace,
) -> Vector:
    """Costates (2 n, K) at the knots of ``space``, from multipliers mu (K, n) of the residual there.

    -M' mu_k is the integral of lambda_v against the spline of degree 1 that is 1 at knot k; then
    lambda_v' = -dH/dv gives lambda_q = -lambda_v' - (da/dv)' lambda_v - dL/dv. NaN where the multipliers are
    not known, as where the model had no finite value.
    """
    dynamics = problem.dynamics
    n = dynamics.coordinates
    tau = trajectory.nodes
    x, u = ca.SX.sym("x", len(problem.states)), ca.SX.sym("u", len(problem.controls))
    t, mu, velocity_costate = ca.SX.sym("t"), ca.SX.sym("mu", n), ca.SX.sym("lambda", n)
    states, controls = ca.vertsplit(x), ca.vertsplit(u)
    scope = problem.scope(states, controls, t, problem.parameters_of(trajectory), CASADI)
    acceleration = ca.SX.sym("a", n)
    residual = ca.vertcat(*map(ca.SX, dynamics.residual(ca.vertsplit(acceleration), scope, CASADI)))
    mass = ca.jacobian(residual, acceleration)
    rate = problem.rate(states, controls, t, problem.parameters_of(trajectory), CASADI)
    hamiltonian = ca.dot(velocity_costate, ca.vertcat(*rate[n : 2 * n]))
    if problem.running_cost is not None:
        hamiltonian += problem.running_cost.evaluate(scope, CASADI.functions)
    numbers = trajectory.states_at(tau), trajectory.controls_at(tau), trajectory.time(tau)[None, :]
    of_velocities = ca.Function("of_velocities", [x, mu], [-ca.mtimes(mass.T, mu)])
    averaged = of_velocities.map(tau.size)(numbers[0], multipliers.T).full()
    lambda_v = space.dual_values(averaged.T, 2).T
    if not np.isfinite(lambda_v).all():
        return np.full((2 * n, tau.size), np.nan)
    lambda_v_rate = CubicSpline(tau, lambda_v, axis=1)(tau, 1) / trajectory.duration
    slope = ca.Function("slope", [x, u, t, velocity_costate], [ca.gradient(hamiltonian, x[n : 2 * n])])
    dissipation = slope.map(tau.size)(*numbers, lambda_v).full()
    return np.vstack([-lambda_v_rate - dissipation, lambda_v])
