"""What the model looks like at both ends of an answer: natural frequencies, damping, the mass matrix."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from solvers.problem import OptimalControlProblem
from solvers.symbolic import CASADI
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

# Below this part of the largest one an eigenvalue is that of a rigid motion.
_RIGID = 1e-9


def model_report(problem: OptimalControlProblem, trajectory: Trajectory) -> dict[str, Any] | None:
    """The ``model_report`` of a result; None where the model is not finite at the ends.

    For each end the natural frequencies in Hz with their damping ratios, ascending, and for equations of
    motion the smallest eigenvalue of the mass matrix. Those of second order are linearised as
    M q'' + C q' + K q = 0; the frequencies are those without damping, each ratio is that of its own mode
    shape. Those of first order come as pairs of complex eigenvalues of df/dx.
    """
    matrices = _linearised(_Structure(problem.structure, problem))
    report = {}
    for end, tau in (("initial", 0.0), ("final", 1.0)):
        at = np.array([tau])
        arguments = (
            trajectory.states_at(at),
            trajectory.controls_at(at),
            trajectory.time(at),
            np.array([*problem.parameters_of(trajectory).values()], np.float64),
        )
        found = [np.asarray(matrix) for matrix in matrices.call([ca.DM(numbers) for numbers in arguments])]
        if not all(np.isfinite(matrix).all() for matrix in found):
            return None
        report[end] = _of_second_order(*found) if problem.dynamics.coordinates else _of_first_order(found[0])
    return report


@dataclass(frozen=True)
class _Structure:
    """A problem that is the same as another where only numbers differ."""

    key: Hashable
    problem: OptimalControlProblem = field(compare=False)


@lru_cache(maxsize=32)
def _linearised(structure: _Structure) -> ca.Function:
    """(x, u, t, p) -> M, C, K of the equations of motion, or df/dx alone."""
    problem = structure.problem
    names = [*problem.parameters, *(item.name for item in problem.design)]
    x, u = ca.SX.sym("x", len(problem.states)), ca.SX.sym("u", len(problem.controls))
    t, p = ca.SX.sym("t"), ca.SX.sym("p", len(names))
    parameters = dict(zip(names, ca.vertsplit(p), strict=True))
    scope = problem.scope(ca.vertsplit(x), ca.vertsplit(u), t, parameters, CASADI)
    dynamics, n = problem.dynamics, problem.dynamics.coordinates
    if not n:
        rate = ca.vertcat(*map(ca.SX, dynamics.rate(scope, CASADI)))
        own = x[: len(problem.states) - len(problem.rated)]
        return ca.Function("slopes", [x, u, t, p], [ca.jacobian(rate[: own.numel()], own)])
    acceleration = ca.SX.sym("a", n)
    residual = ca.vertcat(*map(ca.SX, dynamics.residual(ca.vertsplit(acceleration), scope, CASADI)))
    still = ca.substitute(residual, acceleration, ca.SX.zeros(n))
    slopes = ca.jacobian(still, x)
    outputs = [ca.jacobian(residual, acceleration), slopes[:, n : 2 * n], slopes[:, :n]]
    return ca.Function("matrices", [x, u, t, p], outputs)


def _of_second_order(mass: Vector, damping: Vector, stiffness: Vector) -> dict[str, Any]:
    smallest = float(np.linalg.eigvalsh((mass + mass.T) / 2.0)[0])
    squares, shapes = np.linalg.eig(np.linalg.solve(mass, stiffness))
    swinging = np.flatnonzero(squares.real > _RIGID * np.abs(squares).max(initial=0.0))
    frequencies = np.sqrt(squares[swinging].real)
    ratios = []
    for omega, shape in zip(frequencies, shapes.T[swinging], strict=True):
        weight = (shape.conj() @ mass @ shape).real
        ratios.append(float((shape.conj() @ damping @ shape).real / (2.0 * omega * weight)))
    return _sorted(frequencies, np.array(ratios), smallest)


def _of_first_order(slopes: Vector) -> dict[str, Any]:
    eigenvalues = np.linalg.eigvals(slopes)
    # Where eigenvalues meet, rounding makes pairs of them with imaginary parts of about its square root.
    pairs = eigenvalues[eigenvalues.imag > 1e-6 * np.abs(eigenvalues).max(initial=0.0)]
    omegas = np.abs(pairs)
    return _sorted(omegas, -pairs.real / np.maximum(omegas, np.finfo(float).tiny), None)


def _sorted(omegas: Vector, ratios: Vector, smallest: float | None) -> dict[str, Any]:
    order = np.argsort(omegas)
    return {
        "natural_frequencies_hz": (omegas[order] / (2.0 * np.pi)).tolist(),
        "damping_ratios": ratios[order].tolist(),
        "smallest_mass_eigenvalue": smallest,
    }
