"""Controls in a Daubechies basis, states by Hermite-Simpson on dyadic intervals.

Decision vector, K intervals, N functions:

    x_i: knot 0, middle 0, knot 1, middle 1, ..., knot K   (2 K + 1) for each state
    c_j: the coefficients                                   (N)       for each control
    t0 | tf

The basis enters as parabolas on the intervals, exact at the knots and with exact integrals: states that are
integrals of controls have no error at the knots. A running cost that is quadratic in the controls and names
nothing else comes from the coefficients alone, exactly, for the functions are orthogonal.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.bases.daubechies import DaubechiesBasis
from solvers.coefficients.daubechies import describe
from solvers.curves import DaubechiesCurve
from solvers.expressions import Expression
from solvers.symbolic import CASADI
from solvers.transcription.builder import Intervals, fixed
from solvers.transcription.hermite_simpson import HermiteSimpson

Vector = NDArray[np.float64]


@dataclass
class DaubechiesControls(HermiteSimpson):
    """Hermite-Simpson with the controls in ``basis``, tabulated on ``level``."""

    knots: Vector = field(init=False)
    basis: DaubechiesBasis
    level: int

    def __post_init__(self) -> None:
        self.knots = self.basis.points(self.level)
        super().__post_init__()

    @property
    def mesh(self) -> Hashable:
        """The basis, how finely it is tabulated, and which controls are bounded."""
        return self.basis, self.level, tuple(map(_sides, self.problem.control_bounds))

    @cached_property
    def table(self) -> Vector:
        """Values of the functions at the nodes, (N, 2 K + 1)."""
        return self.basis.parabolas(self.level)

    def allocate_controls(self) -> None:
        """Append the coefficients."""
        self.builder.unknowns(
            "controls",
            (len(self.problem.controls), self.basis.size),
            scale=self.scaling.controls,
            initial=lambda this: this.start_coefficients(),
            bounds=fixed(-np.inf, np.inf),
        )

    def start_coefficients(self) -> Vector:
        """The controls of the start, (m, N), as near as the basis comes."""
        controls = self.start.controls_at(self.tau)
        return np.asarray(np.linalg.lstsq(self.table.T, controls.T)[0].T, np.float64)

    def control_rows(self) -> list[sparse.csr_array]:
        """See :class:`HermiteSimpson`."""
        rows = sparse.csr_array(self.table.T)
        return [self.builder.rows_of(block, rows) for block in self.builder.blocks["controls"]]

    def constrain_dynamics(self) -> None:
        """The defects, and the bounds of the controls at the nodes."""
        super().constrain_dynamics()
        for j, rows in enumerate(self.control_rows()):
            self.builder.hold(self, rows, _bounds_of_control(j), scale=self.scaling.controls[j])

    def straighten_rates(self) -> None:
        """Nothing: the basis decides how a rate runs between the nodes."""

    def control_curves(self, unknowns: Vector) -> Sequence[DaubechiesCurve]:
        """See :class:`HermiteSimpson`."""
        return [
            DaubechiesCurve(self.basis, self.level, unknowns[block.start : block.stop])
            for block in self.builder.blocks["controls"]
        ]

    def described_basis(self) -> dict[str, Any]:
        """See :class:`HermiteSimpson`."""
        return describe(self.basis, self.level)

    def add_running_cost(self) -> None:
        """See :class:`Assembly`; from the coefficients where that is exact."""
        """Energies from the coefficients, other costs by the quadrature of the nodes."""
        running = self.problem.running_cost
        if running is not None and self._is_quadratic(running):
            self._add_energy(running)
        else:
            super().add_running_cost()

    def _is_quadratic(self, cost: Expression) -> bool:
        """Whether a cost is a polynomial of second degree in the controls and names nothing else."""
        problem = self.problem
        fixed_names = problem.parameters.keys() - {item.name for item in problem.design}
        if not cost.names <= {*problem.controls, *fixed_names}:
            return False
        u, p = ca.SX.sym("u", len(problem.controls)), ca.SX.sym("p", len(problem.parameters))
        value = ca.SX(cost.evaluate(self._scope(u, p), CASADI.functions))
        return not ca.depends_on(ca.hessian(value, u)[0], u)

    def _scope(self, u: ca.SX, p: ca.SX) -> Mapping[str, Any]:
        names = [*self.problem.controls, *self.problem.parameters]
        return dict(zip(names, ca.vertsplit(ca.vertcat(u, p)), strict=True))

    def _add_energy(self, cost: Expression) -> None:
        """The integral of f(u) = f(0) + g'u + u'H u / 2 over u = sum_i c_i w_i, one place a function w_i."""
        m, count = len(self.problem.controls), self.basis.size
        z, p = ca.SX.sym("z", m + 2), ca.SX.sym("p", 2 + len(self.problem.parameters))

        def value(u: ca.SX) -> ca.SX:
            return ca.SX(cost.evaluate(self._scope(u, p[2:]), CASADI.functions))

        ahead, behind, nothing = value(z[:m]), value(-z[:m]), value(ca.SX.zeros(m))
        share, mean = p[0], p[1]
        even = (ahead + behind) / 2.0 - nothing
        density = nothing * share + (ahead - behind) / 2.0 * mean + even / self.basis.units
        integrals = self.basis.integrals(self.level)[:, -1]

        def numbers(this: DaubechiesControls) -> Vector:
            parameters = np.tile(np.array([*this.problem.parameters.values()])[:, None], (1, count))
            return np.vstack([np.full(count, 1.0 / count), integrals, parameters])

        function = ca.Function("energy", [z, p], [(z[m + 1] - z[m]) * density])
        rows = [self.builder.rows_of(block) for block in self.builder.blocks["controls"]]
        self.builder.cost(self.builder.apply(function, [*rows, *self.span(count)], numbers), np.ones(count))


def _bounds_of_control(index: int) -> Intervals:
    return lambda this: this.problem.control_bounds[index]


def _sides(interval: tuple[float, float]) -> tuple[bool, ...]:
    return tuple(bool(np.isfinite(bound)) for bound in interval)
