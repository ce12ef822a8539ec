"""Gauss pseudospectral method (GPM): on each segment a polynomial through its start and the Gauss points.

Decision vector, S segments of K_1 ... K_S Legendre-Gauss nodes, a column for each state and control:

    x_i: start of segment 1, its K_1 nodes, start of segment 2, ..., end of segment S   (sum (K_s + 1) + 1)
    u_j: the nodes                                                                       (sum K_s)
    t0 | tf

On a segment of normalised width h, with F = (tf - t0) f at the nodes:  D X - h/2 F = 0  at the nodes, and the
end of the segment by Gauss quadrature, X_end - X_start - h/2 sum_k w_k F_k = 0.

Source: Benson, Huntington, Thorvaldsen, Rao, "Direct trajectory optimization and costate estimation via an
orthogonal collocation method", J. Guidance, Control, and Dynamics 29(6), 2006, doi 10.2514/1.20478.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from itertools import pairwise

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
from solvers.coefficients import lagrange
from solvers.curves import LagrangeCurve
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription, control_columns
from solvers.transcription.builder import fixed
from solvers.transcription.nodes import Instants

Vector = NDArray[np.float64]


@dataclass
class GaussPseudospectral(Transcription):
    """GPM with ``counts`` nodes on the segments between ``breaks`` (normalised, from 0 to 1)."""

    breaks: Vector
    counts: tuple[int, ...]

    def __post_init__(self) -> None:
        self._rules = [legendre_gauss(count) for count in self.counts]
        widths = np.diff(self.breaks)
        inside = [
            start + width * (points + 1.0) / 2.0
            for start, width, (points, _) in zip(self.breaks[:-1], widths, self._rules, strict=True)
        ]
        self.node_tau = np.concatenate(inside)
        pieces = [
            part for start, tau in zip(self.breaks[:-1], inside, strict=True) for part in ([start], tau)
        ]
        self.state_tau = np.concatenate([*pieces, [1.0]])
        self._starts = np.cumsum([0, *[count + 1 for count in self.counts]])

    @property
    def widths(self) -> Vector:
        """The part of its span of time that each segment takes."""
        return np.diff(self.breaks)

    @property
    def mesh(self) -> Hashable:
        """Breaks and numbers of nodes."""
        return tuple(self.breaks), self.counts

    def allocate(self) -> None:
        """See :class:`Transcription`."""
        self.builder.unknowns(
            "states",
            (len(self.problem.states), self.state_tau.size),
            scale=self.scaling.states,
            initial=lambda this: this.start.states_at(this.state_tau),
            bounds=fixed(-np.inf, np.inf),
        )
        self.builder.unknowns(
            "controls",
            (len(self.problem.controls), self.node_tau.size),
            scale=self.scaling.controls,
            initial=lambda this: this.start.controls_at(this.node_tau),
            bounds=lambda this: this.control_bounds(),
        )

    def control_bounds(self) -> tuple[Vector, Vector]:
        """Lower and upper bounds of the controls at the nodes, to be broadcast to (m, K)."""
        return control_columns(self)

    def nodes(self) -> Instants:
        """The nodes and both ends of the segments; controls only stand at the very ends, extrapolated."""
        rows = [self.builder.rows_of(block) for block in self.builder.blocks["states"]]
        return Instants(self.state_tau, rows, self._end_controls())

    def path_instants(self) -> Instants:
        """The Gauss nodes, where the controls are unknowns."""
        node = np.delete(np.arange(self.state_tau.size), self._starts)
        rows = [self.builder.rows_of(block)[node] for block in self.builder.blocks["states"]]
        return Instants(
            self.node_tau, rows, [self.builder.rows_of(block) for block in self.builder.blocks["controls"]]
        )

    def quadrature(self) -> tuple[Instants, Vector]:
        """Gauss quadrature on each segment."""
        return self.path_instants(), self.quadrature_weights

    @property
    def quadrature_weights(self) -> Vector:
        """See :class:`Assembly`."""
        weights = [width / 2.0 * shares for width, (_, shares) in zip(self.widths, self._rules, strict=True)]
        return np.concatenate(weights)

    def constrain_dynamics(self) -> None:
        """Differentiation at the nodes, quadrature to the end of each segment."""
        differences, rates = [], []
        for count, width, (_, shares) in zip(self.counts, self.widths, self._rules, strict=True):
            slopes = np.zeros((count + 1, count + 2))
            slopes[:-1, :-1] = gauss_differentiation_matrix(count)
            slopes[-1, [0, -1]] = -1.0, 1.0
            differences.append(slopes)
            rates.append(-width / 2.0 * np.vstack([np.eye(count), shares]))
        rows = sparse.coo_array(sparse.block_diag(differences))
        # Neighbours share the state between them: the last column of one is the first of the next.
        segment = np.repeat(np.arange(len(self.counts)), np.array(self.counts) + 2)
        shared = rows.col - segment[rows.col]
        matrix = sparse.csr_array((rows.data, (rows.row, shared)), shape=(rows.shape[0], self.state_tau.size))
        states = [self.builder.rows_of(block, matrix) for block in self.builder.blocks["states"]]
        places = self.apply_rate(self.path_instants())
        self.add_defects(states, places, sparse.csr_array(sparse.block_diag(rates)))

    def read(self, unknowns: Vector) -> Trajectory:
        """See :class:`Transcription`."""
        breaks, times = self.read_breaks(unknowns)
        states = {
            name: self._curve(breaks, unknowns[block.start : block.stop], with_ends=True)
            for name, block in zip(self.problem.states, self.builder.blocks["states"], strict=True)
        }
        controls = {
            name: self._curve(breaks, unknowns[block.start : block.stop], with_ends=False)
            for name, block in zip(self.problem.controls, self.builder.blocks["controls"], strict=True)
        }
        nodes = lagrange.gauss_nodes(breaks, self.counts)
        return Trajectory(
            *times,
            states,
            controls,
            interpolation="polynomial",
            basis={"name": lagrange.NAME, "breaks": breaks.tolist(), "nodes": list(self.counts)},
            breakpoints=nodes,
            nodes=nodes,
        )

    def read_breaks(self, unknowns: Vector) -> tuple[Vector, tuple[float, float]]:
        """The normalised breaks and (t0, tf) of a solution."""
        t0, tf = (float(unknowns[block.start]) for block in self.builder.blocks["times"])
        return self.breaks, (t0, tf)

    def spread(self, costates: Vector) -> Vector:
        """Segment by segment, the polynomial through the Gauss nodes gives the values at the ends."""
        pieces = []
        for values, to_ends in zip(self._by_segment(costates), self._to_ends(), strict=True):
            ends = values @ to_ends.T
            pieces += [ends[:, :1], values]
        return np.column_stack([*pieces, ends[:, 1:]])

    def _curve(self, breaks: Vector, values: Vector, *, with_ends: bool) -> LagrangeCurve:
        if with_ends:
            pieces = [values[i:j] for i, j in pairwise(self._starts)]
            return LagrangeCurve(breaks, tuple(map(gauss_support, self.counts)), tuple(pieces))
        points = tuple(points for points, _ in self._rules)
        return LagrangeCurve(breaks, points, tuple(self._by_segment(values)))

    def _by_segment(self, values: Vector) -> list[Vector]:
        return np.split(values, np.cumsum(self.counts)[:-1], axis=-1)

    def _to_ends(self) -> list[Vector]:
        """For each segment the matrix from values at its Gauss nodes to its two ends."""
        ends = np.array([-1.0, 1.0])
        return [
            lagrange_matrix(points, gauss_barycentric_weights(count, initial_point=False), ends)
            for count, (points, _) in zip(self.counts, self._rules, strict=True)
        ]

    def _end_controls(self) -> list[sparse.csr_array]:
        to_ends = self._to_ends()
        rows = sparse.lil_array((self.state_tau.size, self.node_tau.size))
        rows[0, : self.counts[0]], rows[-1, -self.counts[-1] :] = to_ends[0][0], to_ends[-1][1]
        return [
            self.builder.rows_of(block, sparse.csr_array(rows)) for block in self.builder.blocks["controls"]
        ]
