"""Gauss pseudospectral method (GPM): on each segment a polynomial through its start and the Gauss points.

Decision vector, S segments of K Legendre-Gauss nodes, a column for each state and control:

    x_i: start of segment 1, its K nodes, start of segment 2, ..., end of segment S   (S (K + 1) + 1)
    u_j: the nodes                                                                     (S K)
    t0 | tf

On a segment of normalised width h, with F = (tf - t0) f at the nodes:  D X - h/2 F = 0  at the nodes, and the
end of the segment by Gauss quadrature, X_end - X_start - h/2 sum_k w_k F_k = 0.

Source: Benson, Huntington, Thorvaldsen, Rao, "Direct trajectory optimization and costate estimation via an
orthogonal collocation method", J. Guidance, Control, and Dynamics 29(6), 2006, doi 10.2514/1.20478.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.bases.legendre import (
    gauss_barycentric_weights,
    gauss_differentiation_matrix,
    gauss_support,
    lagrange_matrix,
    legendre_gauss,
)
from solvers.coefficients import LAGRANGE
from solvers.curves import LagrangeCurve
from solvers.trajectory import Trajectory
from solvers.transcription.base import Instants, Transcription

Vector = NDArray[np.float64]


@dataclass
class GaussPseudospectral(Transcription):
    """GPM with ``count`` nodes on each segment between ``breaks`` (normalised, from 0 to 1)."""

    breaks: Vector
    count: int
    _states: list[range] = field(default_factory=list, init=False)
    _controls: list[range] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._points, self._weights = legendre_gauss(self.count)
        widths = np.diff(self.breaks)
        self._tau = (self.breaks[:-1, None] + widths[:, None] * (self._points + 1.0) / 2.0).ravel()
        starts = np.column_stack([self.breaks[:-1], self._tau.reshape(-1, self.count)])
        self._state_tau = np.append(starts.ravel(), 1.0)

    def allocate(self) -> None:
        """See :class:`Transcription`."""
        start, scaling = self.start, self.scaling
        self._states = [
            self.builder.unknowns(values, scale=scaling.states[i])
            for i, values in enumerate(start.states_at(self._state_tau))
        ]
        self._controls = [
            self.builder.unknowns(values, scale=scaling.controls[j], lower=bounds[0], upper=bounds[1])
            for j, (values, bounds) in enumerate(
                zip(start.controls_at(self._tau), self.problem.control_bounds, strict=True)
            )
        ]

    def nodes(self) -> Instants:
        """The nodes and both ends of the segments; controls only stand at the very ends, extrapolated."""
        rows = [self.builder.rows_of(block) for block in self._states]
        return Instants(self._state_tau, rows, self._end_controls())

    def path_instants(self) -> Instants:
        """The Gauss nodes, where the controls are unknowns."""
        node = np.delete(np.arange(self._state_tau.size), np.s_[:: self.count + 1])
        rows = [self.builder.rows_of(block)[node] for block in self._states]
        return Instants(self._tau, rows, [self.builder.rows_of(block) for block in self._controls])

    def quadrature(self) -> tuple[Instants, Vector]:
        """Gauss quadrature on each segment."""
        return self.path_instants(), np.outer(np.diff(self.breaks) / 2.0, self._weights).ravel()

    def constrain_dynamics(self) -> None:
        """Differentiation at the nodes, quadrature to the end of each segment."""
        slopes = np.zeros((self.count + 1, self.count + 2))
        slopes[:-1, :-1] = gauss_differentiation_matrix(self.count)
        slopes[-1, [0, -1]] = -1.0, 1.0
        segments = self.breaks.size - 1
        rows = sparse.coo_array(sparse.kron(sparse.eye_array(segments), sparse.coo_array(slopes)))
        # Neighbours share the state between them: the last column of one is the first of the next.
        shared = rows.col - rows.col // (self.count + 2)
        differences = sparse.csr_array(
            (rows.data, (rows.row, shared)), shape=(rows.shape[0], self._state_tau.size)
        )
        local = np.vstack([np.eye(self.count), self._weights])
        rates = sparse.kron(sparse.diags_array(-np.diff(self.breaks) / 2.0), sparse.coo_array(local))
        states = [self.builder.rows_of(block, differences) for block in self._states]
        self.add_defects(states, self.apply_rate(self.path_instants()), sparse.csr_array(rates))

    def read(self, unknowns: Vector) -> Trajectory:
        """See :class:`Transcription`."""
        t0, tf = (float(unknowns[block.start]) for block in self.times)
        segments = self.breaks.size - 1
        states = [unknowns[block.start : block.stop - 1].reshape(segments, -1) for block in self._states]
        controls = [unknowns[block.start : block.stop].reshape(segments, -1) for block in self._controls]
        return Trajectory(
            t0,
            tf,
            {
                name: LagrangeCurve(self.breaks, gauss_support(self.count), values)
                for name, values in zip(self.problem.states, states, strict=True)
            },
            {
                name: LagrangeCurve(self.breaks, self._points, values)
                for name, values in zip(self.problem.controls, controls, strict=True)
            },
            interpolation="polynomial",
            basis={"name": LAGRANGE, "nodes": self.count, "segments": segments},
            breakpoints=self._state_tau,
            nodes=self._state_tau,
        )

    def spread(self, costates: Vector) -> Vector:
        """Segment by segment, the polynomial through the Gauss nodes gives the values at the ends."""
        weights = gauss_barycentric_weights(self.count, initial_point=False)
        to_ends = lagrange_matrix(self._points, weights, np.array([-1.0, 1.0]))
        by_segment = costates.reshape(costates.shape[0], -1, self.count)
        ends = by_segment @ to_ends.T
        starts = np.concatenate([ends[:, :, :1], by_segment], axis=2)
        return np.column_stack([starts.reshape(costates.shape[0], -1), ends[:, -1, 1]])

    def _end_controls(self) -> list[sparse.csr_array]:
        weights = gauss_barycentric_weights(self.count, initial_point=False)
        ends = lagrange_matrix(self._points, weights, np.array([-1.0, 1.0]))
        rows = sparse.lil_array((self._state_tau.size, self._tau.size))
        rows[0, : self.count], rows[-1, -self.count :] = ends
        return [self.builder.rows_of(block, sparse.csr_array(rows)) for block in self._controls]
