"""A running cost that is quadratic in the controls: its integral from the coefficients, exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from solvers.arrays.structure import degree, depends_on, value_at
from solvers.bases.daubechies import DaubechiesBasis
from solvers.genetic.model import ArrayModel

Vector = NDArray[np.float64]


def energy_of(model: ArrayModel, basis: DaubechiesBasis) -> Callable[[Vector], Vector] | None:
    """The integral of the running cost over tau, (P,), from coefficients (P, m N).

    c + g'u + u'H u / 2 over u = sum_i c_i w_i, with orthogonal functions w_i whose square has the integral
    1/units. None where the running cost is of another form.
    """
    cost, controls = model.running_cost, model.problem.controls
    if not depends_on([cost]) <= set(controls) or degree(cost, controls) > 2.0:
        return None
    units = [{name: 1.0} for name in controls]
    constant = value_at(cost, {})
    ahead = np.array([value_at(cost, unit) for unit in units])
    behind = np.array([value_at(cost, dict.fromkeys(unit, -1.0)) for unit in units])
    pairs = np.array([[value_at(cost, _sum(a, b)) for b in units] for a in units]).reshape(len(units), -1)
    slopes = (ahead - behind) / 2.0
    curvature = pairs - ahead[:, None] - ahead[None, :] + constant
    linear = np.outer(slopes, basis.integrals(basis.levels)[:, -1]).ravel()
    quadratic = np.kron(curvature, np.eye(basis.size)) / (2.0 * basis.units)
    alone = constant == 0.0 and not linear.any()

    def energy(coefficients: Vector) -> Vector:
        total = np.einsum("pi,pi->p", coefficients @ quadratic, coefficients)
        return np.asarray(total if alone else total + (constant + coefficients @ linear))

    return energy


def _sum(first: dict[str, float], second: dict[str, float]) -> dict[str, float]:
    return {name: first.get(name, 0.0) + second.get(name, 0.0) for name in first | second}
