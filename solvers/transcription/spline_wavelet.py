"""Spline wavelet collocation (SWCM): states are cubic splines, controls are values where the dynamics hold.

Decision vector, N = intervals + 3:

    second order:  c[q_1] (N) ... c[q_n] (N) | u_1 (knots) ... u_m (knots) | t0 | tf
    first order:   c[x_1] (N) ... c[x_n] (N) | u_1 (N - 1) ... u_m (N - 1) | t0 | tf

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
from scipy.interpolate import BSpline

from solvers.bases.banded import solve_banded_system
from solvers.bases.graded import GradedKnots
from solvers.bases.legendre import legendre_gauss
from solvers.coefficients import SPLINE_WAVELET
from solvers.costates import second_order_costates
from solvers.curves import Curve, DerivativeCurve, LinearCurve, SplineCurve
from solvers.quantities import Interval
from solvers.symbolic import CASADI
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription, control_columns
from solvers.transcription.builder import fixed
from solvers.transcription.nodes import Instants, NodeSymbols

Vector = NDArray[np.float64]

_COST_POINTS = 3


@dataclass
class SplineWavelet(Transcription):
    """SWCM on ``knots``, uniform or graded; ``adaptive``: the result lists the active wavelets."""

    knots: GradedKnots
    adaptive: bool = False

    def __post_init__(self) -> None:
        coordinates = self.problem.dynamics.coordinates
        self._second_order = coordinates > 0
        self._splines = coordinates or len(self.problem.states)
        self.space = self.knots.space
        self.points = self.space.greville(2 if self._second_order else 1)
        self._smooth_controls = (
            self.adaptive
            and not self._second_order
            and (self.problem.running_cost is not None or bool(self.problem.integrals))
            and not np.isfinite(self.problem.control_bounds).any()
        )

    @property
    def per_tau(self) -> Collection[int]:
        """Velocities of a second-order model are derivatives of the splines."""
        return range(self._splines, len(self.problem.states))

    @property
    def mesh(self) -> Hashable:
        """The knots, how controls stand in the unknowns, and the scales of the equations of motion."""
        scale = tuple(self.scaling.equations) if self._second_order else ()
        return tuple(self.space.knots), self._smooth_controls, scale

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
            (len(self.problem.controls), self.points.size),
            scale=self.scaling.controls,
            initial=lambda this: this.start_controls(),
            bounds=control_columns,
        )

    def start_coefficients(self) -> Vector:
        """Coefficients of the splines through the start, one row each; exact where it is a coarser spline."""
        states = self.start.states_at(self.space.interpolation_points)
        return self.space.interpolate(states[: self._splines].T).T

    def start_controls(self) -> Vector:
        """The unknowns of the controls at the start, one row each."""
        values = self.start.controls_at(self.points)
        if not self._smooth_controls:
            return values
        return solve_banded_system(_quadratic_splines(self.space.knots, self.points), values.T).T

    def nodes(self) -> Instants:
        """The knots."""
        return self._at_points if self._second_order else self._instants(self.space.knots)

    def path_instants(self) -> Instants:
        """The collocation points."""
        return self._at_points

    def quadrature(self) -> tuple[Instants, Vector]:
        """Second order: Simpson on each interval. First order: the weights of the collocation points.

        The latter satisfy w D1 = e(tf) - e(t0).
        """
        knots = self.space.knots
        if self._smooth_controls:
            inside, shares = legendre_gauss(_COST_POINTS)
            tau = knots[:-1, None] + np.diff(knots)[:, None] * (inside + 1.0) / 2.0
            return self._instants(tau.ravel()), (np.diff(knots)[:, None] * shares / 2.0).ravel()
        if not self._second_order:
            return self._at_points, self.space.quadrature_weights(1)
        points = np.empty(2 * knots.size - 1)
        points[::2], points[1::2] = knots, (knots[1:] + knots[:-1]) / 2
        widths = np.diff(knots)
        weights = np.zeros(points.size)
        weights[:-2:2] += widths / 6
        weights[1::2] += 4 * widths / 6
        weights[2::2] += widths / 6
        return self._instants(points), weights

    def constrain_dynamics(self) -> None:
        """Second order: M q'' + C q' + K q - G u - f = 0. First order: x' - f = 0."""
        instants = self._at_points
        if self._second_order:
            symbols = NodeSymbols(self.problem, self.per_tau, self._splines)
            residual = self.problem.dynamics.residual(symbols.accelerations, symbols.scope, CASADI)
            accelerations = self._spline_rows(self.points, 2)
            places = self.apply(symbols.function("residual", residual), instants, accelerations)
            scale = np.tile(self.scaling.equations, self.points.size)
            self.builder.constrain(fixed(0.0, 0.0), scale=scale, places=places)
            self.builder.places["residual"] = places
            return
        slopes = self._spline_rows(self.points, 1)
        self.add_defects(
            slopes, self.apply_rate(instants), -sparse.csr_array(sparse.eye_array(self.points.size))
        )

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
        controls = [
            LinearCurve(self.points, self._as_flown(row, bounds))
            for row, bounds in zip(values, self.problem.control_bounds, strict=True)
        ]
        return Trajectory(
            t0,
            tf,
            dict(zip(self.problem.states, splines + velocities, strict=True)),
            dict(zip(self.problem.controls, controls, strict=True)),
            interpolation="linear",
            basis={
                "name": SPLINE_WAVELET,
                "L": self.knots.L,
                "J": self.knots.finest,
                "derivative": 2 if self._second_order else 1,
                **({"active": [indices.tolist() for indices in self.knots.active]} if self.adaptive else {}),
            },
            breakpoints=np.union1d(self.points, self.space.knots),
            nodes=self.points,
        )

    def _as_flown(self, values: Vector, bounds: Interval) -> Vector:
        """Values between which a control is linear, from those at the points where the dynamics hold.

        On an adaptive mesh for equations of first order: the straight lines that come nearest in the mean to
        the quadratic spline through the values. Lines through the values themselves would err to one side
        wherever the control is curved, which adds up over a flight. A control that rests on a bound stays.
        """
        smooth = self.adaptive and not self._second_order
        if not smooth or not np.all((values > bounds[0]) & (values < bounds[1])):
            return values
        space = self.space.knots
        coefficients = solve_banded_system(_quadratic_splines(space, self.points), values)
        breaks = np.union1d(self.points, space)
        inside, shares = legendre_gauss(_COST_POINTS)
        tau = (breaks[:-1, None] + np.diff(breaks)[:, None] * (inside + 1.0) / 2.0).ravel()
        weights = sparse.diags_array((np.diff(breaks)[:, None] * shares / 2.0).ravel())
        hats = _hat_functions(self.points, tau)
        wanted = hats.T @ (weights @ (_quadratic_splines(space, tau) @ coefficients))
        flown = solve_banded_system(sparse.csr_array(hats.T @ weights @ hats), wanted)
        return flown if np.all((flown >= bounds[0]) & (flown <= bounds[1])) else values

    def costates(self, trajectory: Trajectory, row_multipliers: Vector) -> Vector:
        """See :class:`Transcription`; second order: from the multipliers mu of the equations of motion.

        A change of the acceleration is the spline of degree 1 through its values d_k at the knots, each of
        which is a residual -M d_k: lambda_v is what has the integrals -M' mu_k / (tf - t0) against these
        splines. For first order the same with degree 2 and the defects.
        """
        places = self.builder.places["residual" if self._second_order else "rates"]
        adjoint = self.builder.adjoint(places, row_multipliers) * self.scaling.objective
        weights = adjoint.reshape(self.points.size, -1)
        if not self._second_order:
            return self.space.dual_values(weights, 1).T
        weights = weights / trajectory.duration
        problem = self.weighted_problem(row_multipliers)
        return second_order_costates(problem, trajectory, weights, self.space)

    @cached_property
    def _at_points(self) -> Instants:
        """The collocation points; for equations of second order these are the knots."""
        return self._instants(self.points)

    def _instants(self, tau: Vector) -> Instants:
        states = self._spline_rows(tau, 0)
        if self._second_order:
            states += self._spline_rows(tau, 1)
        rows = self._control_rows(tau)
        return Instants(
            tau, states, [self.builder.rows_of(block, rows) for block in self.builder.blocks["controls"]]
        )

    def _control_rows(self, tau: Vector) -> sparse.csr_array:
        """Rows of the value of a control."""
        if self._smooth_controls:
            return _quadratic_splines(self.space.knots, tau)
        return _hat_functions(self.points, tau)

    def _spline_rows(self, tau: Vector, derivative: int) -> list[sparse.csr_array]:
        """Rows of the derivative of each spline with respect to tau."""
        matrix = self.space.matrix(tau, derivative)
        return [self.builder.rows_of(block, matrix) for block in self.builder.blocks["coefficients"]]


def _quadratic_splines(knots: Vector, tau: Vector) -> sparse.csr_array:
    """Rows of the B-splines of degree 2 on ``knots``."""
    clamped = np.concatenate([np.zeros(2), knots, np.ones(2)])
    return sparse.csr_array(BSpline.design_matrix(tau, clamped, 2))


def _hat_functions(points: Vector, tau: Vector) -> sparse.csr_array:
    """Rows of linear interpolation between ``points``."""
    left = np.clip(np.searchsorted(points, tau, side="right") - 1, 0, points.size - 2)
    fraction = (tau - points[left]) / (points[left + 1] - points[left])
    rows = np.arange(tau.size)
    matrix = sparse.csr_array(
        (
            np.concatenate([1.0 - fraction, fraction]),
            (np.concatenate([rows, rows]), np.concatenate([left, left + 1])),
        ),
        shape=(tau.size, points.size),
    )
    matrix.eliminate_zeros()
    return matrix
