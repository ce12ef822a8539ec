"""Spline wavelet collocation (SWCM): states are cubic splines, controls are values where the dynamics hold.

Decision vector, N = intervals + 3:

    second order:  c[q_1] (N) ... c[q_n] (N) | u_1 (knots) ... u_m (knots) | t0 | tf
    first order:   c[x_1] (N) ... c[x_n] (N) | u_1 (N - 1) ... u_m (N - 1) | t0 | tf

Rated controls are ramps with unknowns of their own (:mod:`solvers.transcription.ramps`), before t0.

c are coefficients in the banded B-spline basis, which spans the same space as the wavelets of levels V0,
W0, ..., W(J-1); the wavelet coefficients follow by the fast transform. The dynamics are collocated at the
Greville points of the space in which the highest derivative lives: the knots for equations of second order,
the ends and the midpoints of the intervals for equations of first order. Controls enter there only, so their
values there are the unknowns, with simple bounds; between them the control is linear, as the second
derivative of a cubic spline is.

On graded knots the weights of the collocation points are exact for the splines x' alone, not for their
products with the costate, and controls beside a change of the step would err by a part of the step. So where
an adaptive mesh meets a running cost and controls without bounds, these are quadratic splines like x', with
their B-spline coefficients as unknowns, and the cost is integrated by Gauss points on each interval.

Source: Zhang, Feng, Tang, Macdonald, "A spline wavelet collocation method for the optimal control of flexible
spacecraft", Proc. IMechE Part G, 2014, doi 10.1177/0954410014528885, eqs. 36-52.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.bases.banded import solve_banded_system
from solvers.bases.graded import GradedKnots
from solvers.bases.legendre import composite_gauss
from solvers.coefficients import spline_wavelet
from solvers.costates import second_order_costates
from solvers.curves import Curve, DerivativeCurve, LinearCurve, SplineCurve
from solvers.formulation.quantities import Interval
from solvers.symbolic import CASADI
from solvers.trajectory import Trajectory
from solvers.transcription.assembly import columns
from solvers.transcription.base import Transcription
from solvers.transcription.builder import fixed
from solvers.transcription.nodes import Instants, NodeSymbols
from solvers.transcription.ramps import (
    allocate_ramps,
    constrain_ramps,
    ramp_costates,
    rate_indices,
    rate_rows,
)
from solvers.transcription.spline_controls import (
    COST_POINTS,
    hat_functions,
    nearest_lines,
    quadratic_splines,
)
from solvers.transcription.spline_quadrature import hat_means, simpson

Vector = NDArray[np.float64]


@dataclass
class SplineWavelet(Transcription):
    """SWCM on ``knots``, uniform or graded; ``adaptive``: the result lists the active wavelets."""

    knots: GradedKnots
    adaptive: bool = False

    def __post_init__(self) -> None:
        coordinates = self.problem.dynamics.coordinates
        self._second_order = coordinates > 0
        self._splines = coordinates or len(self.problem.states) - len(self.problem.rated)
        self.space = self.knots.space
        self.points = self.space.greville(2 if self._second_order else 1)
        self._in_the_mean = self.adaptive and self._second_order
        self._smooth_controls = (
            self.adaptive
            and not self.problem.rated
            and not self._second_order
            and (self.problem.running_cost is not None or bool(self.problem.integrals))
            and not np.isfinite(self.problem.control_bounds).any()
        )

    @property
    def per_tau(self) -> Collection[int]:
        """Velocities of a second-order model are derivatives of the splines."""
        return range(self._splines, 2 * self._splines) if self._second_order else ()

    @property
    def mesh(self) -> Hashable:
        """The knots, how controls and equations stand on them, and the scales of the equations of motion."""
        scale = tuple(self.scaling.equations) if self._second_order else ()
        return tuple(self.space.knots), self._smooth_controls, self._in_the_mean, scale

    def allocate(self) -> None:
        """See :class:`Transcription`."""
        self.builder.unknowns(
            "coefficients",
            (self._splines, self.space.dimension),
            scale=self.scaling.states[: self._splines],
            initial=lambda this: this.start_coefficients(),
            bounds=fixed(-np.inf, np.inf),
        )
        self.builder.unknowns(
            "controls",
            (len(self._free), self.points.size),
            scale=self.scaling.controls[self._free],
            initial=lambda this: this.start_controls(),
            bounds=lambda this: columns([this.problem.control_bounds[j] for j in this._free]),
        )
        allocate_ramps(self, self.points)

    @cached_property
    def _free(self) -> list[int]:
        """The controls that are chosen themselves, not their rates."""
        rates = rate_indices(self)
        return [j for j in range(len(self.problem.controls)) if j not in rates]

    def state_bounds(self, index: int, count: int) -> tuple[Vector, Vector]:
        """See :class:`Assembly`; rated controls are unknowns with bounds of their own, but for the ends."""
        lower, upper = super().state_bounds(index, count)
        if index >= len(self.problem.states) - len(self.problem.rated):
            lower[1:-1], upper[1:-1] = -np.inf, np.inf
        return lower, upper

    def start_coefficients(self) -> Vector:
        """Coefficients of the splines through the start, one row each; exact where it is a coarser spline."""
        states = self.start.states_at(self.space.interpolation_points)
        return self.space.interpolate(states[: self._splines].T).T

    def start_controls(self) -> Vector:
        """The unknowns of the controls at the start, one row each."""
        values = self.start.controls_at(self.points)[self._free]
        if not self._smooth_controls:
            return values
        return solve_banded_system(quadratic_splines(self.space.knots, self.points), values.T).T

    def nodes(self) -> Instants:
        """The knots."""
        return self._at_points if self._second_order else self._instants(self.space.knots)

    def path_instants(self) -> Instants:
        """The collocation points, each from both sides where rates may jump."""
        return self._from_both_sides() if self.problem.rated else self._at_points

    def quadrature(self) -> tuple[Instants, Vector]:
        """Second order: Simpson on each interval. First order: the weights of the collocation points.

        The latter satisfy w D1 = e(tf) - e(t0).
        """
        knots = self.space.knots
        if self._smooth_controls:
            tau, weights = composite_gauss(knots, COST_POINTS)
            return self._instants(tau), weights
        if not self._second_order:
            weights = self.space.quadrature_weights(1)
            if not self.problem.rated:
                return self._at_points, weights
            halves = np.repeat(weights, 2)[1:-1]
            halves[1:-1] /= 2.0
            return self._from_both_sides(), halves
        widths = np.diff(knots)
        if self.problem.rated:
            thirds = np.array([1.0, 4.0, 1.0]) / 6.0
            tau = knots[:-1, None] + widths[:, None] * np.array([0.0, 0.5, 1.0])
            intervals = np.repeat(np.arange(widths.size), 3)
            return self._instants(tau.ravel(), intervals), (widths[:, None] * thirds).ravel()
        points, weights = simpson(knots)
        return self._instants(points), weights

    def constrain_dynamics(self) -> None:
        """Second order: M q'' + C q' + K q - G u - f = 0. First order: x' - f = 0."""
        constrain_ramps(self, self.points, self._instants((self.points[1:] + self.points[:-1]) / 2.0))
        if self._second_order:
            self._constrain_motion()
            return
        slopes = self._spline_rows(self.points, 1)
        self.add_defects(
            slopes,
            self.apply_rate(self._at_points, self._splines),
            -sparse.csr_array(sparse.eye_array(self.points.size)),
        )

    def _constrain_motion(self) -> None:
        """The equations of second order, at the knots or in the mean over their hat functions."""
        symbols = NodeSymbols(self.problem, self.per_tau, self._splines)
        residual = self.problem.dynamics.residual(symbols.accelerations, symbols.scope, CASADI)
        instants, scatter = self._at_points, None
        if self._in_the_mean:
            tau, means = hat_means(self.points)
            instants = self._instants(tau)
            scatter = sparse.kron(means, sparse.eye_array(self._splines), format="csr")
        accelerations = self._spline_rows(instants.tau, 2)
        places = self.apply(symbols.function("residual", residual), instants, accelerations)
        scale = np.tile(self.scaling.equations, self.points.size)
        self.builder.constrain(fixed(0.0, 0.0), scale=scale, places=places, scatter=scatter)
        self.builder.places["residual"] = places

    def read(self, unknowns: Vector) -> Trajectory:
        """See :class:`Transcription`."""
        t0, tf = (float(unknowns[block.start]) for block in self.builder.blocks["times"])
        splines: list[Curve] = [
            SplineCurve(self.space, unknowns[block.start : block.stop])
            for block in self.builder.blocks["coefficients"]
        ]
        velocities: list[Curve] = [
            DerivativeCurve(splines[i - self._splines], 1.0 / (tf - t0)) for i in self.per_tau
        ]
        values = [unknowns[block.start : block.stop] for block in self.builder.blocks["controls"]]
        if self._smooth_controls:
            at_points = self._control_rows(self.points)
            values = [at_points @ row for row in values]
        controls: dict[str, Curve] = {
            self.problem.controls[j]: LinearCurve(
                self.points, self._flown(row, self.problem.control_bounds[j])
            )
            for j, row in zip(self._free, values, strict=True)
        }
        ramps = {
            name: LinearCurve(self.points, unknowns[block.start : block.stop])
            for name, block in zip(self.problem.rated, self.builder.blocks["ramps"], strict=True)
        }
        controls |= {f"{name}_dot": DerivativeCurve(ramp, 1.0 / (tf - t0)) for name, ramp in ramps.items()}
        return Trajectory(
            t0,
            tf,
            dict(zip(self.problem.states, [*splines, *velocities, *ramps.values()], strict=True)),
            {name: controls[name] for name in self.problem.controls},
            interpolation="linear",
            basis={
                "name": spline_wavelet.NAME,
                "L": self.knots.L,
                "J": self.knots.finest,
                "derivative": 2 if self._second_order else 1,
                **({"ramps": list(ramps)} if ramps else {}),
                **({"active": [indices.tolist() for indices in self.knots.active]} if self.adaptive else {}),
            },
            breakpoints=np.union1d(self.points, self.space.knots),
            nodes=self.points,
        )

    def _flown(self, values: Vector, bounds: Interval) -> Vector:
        """Values between which a control is linear, from those at the points where the dynamics hold."""
        if not self.adaptive or self._second_order:
            return values
        return nearest_lines(self.space.knots, self.points, values, bounds)

    def costates(self, trajectory: Trajectory, row_multipliers: Vector) -> Vector:
        """See :class:`Transcription`; second order: from the multipliers mu of the equations of motion.

        A change of the acceleration is the spline of degree 1 through its values d_k at the knots, each of
        which is a residual -M d_k: lambda_v is what has the integrals -M' mu_k / (tf - t0) against these
        splines. For first order the same with degree 2 and the defects.
        """
        places = self.builder.places["residual" if self._second_order else "rates"]
        adjoint = self.builder.adjoint(places, row_multipliers) * self.scaling.objective
        weights = adjoint.reshape(-1, self._splines)
        if self._in_the_mean:
            # Integrals against the hats, from those at the Gauss points.
            weights = hat_functions(self.points, hat_means(self.points)[0]).T @ weights
        ramps = ramp_costates(self, self.points, trajectory, row_multipliers)
        if not self._second_order:
            return np.vstack([self.space.dual_values(weights, 1).T, ramps])
        weights = weights / trajectory.duration
        problem = self.weighted_problem(row_multipliers)
        return np.vstack([second_order_costates(problem, trajectory, weights, self.space), ramps])

    @cached_property
    def _at_points(self) -> Instants:
        """The collocation points; for equations of second order these are the knots."""
        return self._instants(self.points)

    def _from_both_sides(self) -> Instants:
        """The points, those inside twice: as the end of one interval and as the start of the next."""
        intervals = np.repeat(np.arange(self.points.size - 1), 2)
        return self._instants(np.repeat(self.points, 2)[1:-1], intervals)

    def _instants(self, tau: Vector, intervals: NDArray[np.intp] | None = None) -> Instants:
        """Instants with the rates of these intervals between points, by default those that begin there."""
        states, builder = self._spline_rows(tau, 0), self.builder
        if self._second_order:
            states += self._spline_rows(tau, 1)
        hats = hat_functions(self.points, tau) if self.problem.rated else None
        states += [builder.rows_of(block, hats) for block in builder.blocks["ramps"]]
        rows = self._control_rows(tau)
        free = [builder.rows_of(block, rows) for block in builder.blocks["controls"]]
        if intervals is None:
            found = np.searchsorted(self.points, tau, side="right") - 1
            intervals = np.clip(found, 0, self.points.size - 2)
        controls = dict(zip(self._free, free, strict=True))
        controls |= dict(zip(rate_indices(self), rate_rows(builder, intervals), strict=True))
        return Instants(tau, states, [controls[j] for j in range(len(controls))])

    def _control_rows(self, tau: Vector) -> sparse.csr_array:
        """Rows of the value of a control."""
        if self._smooth_controls:
            return quadratic_splines(self.space.knots, tau)
        return hat_functions(self.points, tau)

    def _spline_rows(self, tau: Vector, derivative: int) -> list[sparse.csr_array]:
        """Rows of the derivative of each spline with respect to tau."""
        matrix = self.space.matrix(tau, derivative)
        return [self.builder.rows_of(block, matrix) for block in self.builder.blocks["coefficients"]]
