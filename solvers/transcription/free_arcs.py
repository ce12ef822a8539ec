"""Gauss collocation on arcs: the instants between them are unknowns, controls rest on bounds along arcs.

Decision vector: the states and controls of the Gauss pseudospectral method, each arc made of one or more of
its segments, and

    s_1 ... s_(S-1) | t0 | tf        (s: the instants between the S arcs)

A node counts its time over its own arc, of which every segment is a fixed part. On an arc where a control is
pinned to a bound its nodes are fixed, so that the control switches exactly at s and is exactly on its bound
in between.

Source: Betts, Practical Methods for Optimal Control, SIAM 2010, 3.7 (phases); Maurer, Buskens, Kim, Kaya,
"Optimization methods for the verification of second order sufficient conditions for bang-bang controls",
Optim. Control Appl. Meth. 26, 2005.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.transcription.builder import Intervals, fixed
from solvers.transcription.gauss_pseudospectral import GaussPseudospectral
from solvers.transcription.nodes import Instants

Vector = NDArray[np.float64]

# An arc may shrink to nothing while the optimizer looks for the structure, but never run backwards.
_SHORTEST_ARC = 0.0


@dataclass
class FreeArcs(GaussPseudospectral):
    """Gauss collocation on segments between ``breaks``; the breaks where a new arc begins are free.

    ``parts``: for each arc the ends of its segments as parts of it, from 0 to 1; ``pinned``: for each
    control, by arc, the value it rests on, NaN where it is free.
    """

    parts: tuple[tuple[float, ...], ...]
    pinned: Mapping[str, Vector]

    @property
    def widths(self) -> Vector:
        """The part of its arc that each segment takes."""
        return np.concatenate([np.diff(part) for part in self.parts])

    @property
    def mesh(self) -> Hashable:
        """Arcs and their nodes; where they start is for the optimizer to find."""
        free = tuple(tuple(np.isnan(levels).tolist()) for levels in self.pinned.values())
        bounded = tuple(bool(np.isfinite(bounds).any()) for bounds in self.problem.control_bounds)
        return self.parts, self.counts, free, bounded

    @cached_property
    def arc_of_segment(self) -> NDArray[np.intp]:
        """For each segment the index of its arc."""
        return np.repeat(np.arange(len(self.parts)), [len(part) - 1 for part in self.parts])

    @cached_property
    def arc_of_node(self) -> NDArray[np.intp]:
        """For each Gauss node the index of its arc."""
        return np.repeat(self.arc_of_segment, self.counts)

    @property
    def edges(self) -> Vector:
        """Where the arcs start, normalised, at the start of the solve."""
        return self.breaks[self._first_segments[:-1]]

    def allocate(self) -> None:
        """See :class:`Transcription`."""
        super().allocate()
        self.builder.unknowns(
            "instants",
            (len(self.parts) - 1, 1),
            scale=self.scaling.time,
            initial=lambda this: (this.start.t0 + (this.start.tf - this.start.t0) * this.edges[1:])[:, None],
            bounds=fixed(-np.inf, np.inf),
        )

    def control_bounds(self) -> tuple[Vector, Vector]:
        """The bounds of the document, or the pinned value twice."""
        lower, upper = super().control_bounds()
        rows = [self.pinned[name][self.arc_of_node] for name in self.problem.controls]
        pinned = np.array(rows).reshape(-1, self.node_tau.size)
        free = np.isnan(pinned)
        return np.where(free, lower, pinned), np.where(free, upper, pinned)

    def path_bounds(self, count: int) -> tuple[Vector, Vector]:
        """See :class:`Transcription`."""
        return self.path_bounds_in(self.arc_of_node)

    def path_bounds_in(self, arcs: NDArray[np.intp]) -> tuple[Vector, Vector]:
        """The bounds of path constraints at instants that belong to these arcs."""
        return super().path_bounds(arcs.size)

    def met_otherwise(self, control: int, side: int) -> Sequence[int]:
        """The arcs at whose start (0) or end (1) something else says where a free control meets a bound."""
        return ()

    def path_instants(self) -> Instants:
        """The Gauss nodes, each with the span of its arc."""
        plain = super().path_instants()
        rows, arc = self.edge_rows(), self.arc_of_node
        starts = np.concatenate([part[:-1] for part in self.parts])
        local = [
            start + width * (points + 1.0) / 2.0
            for start, width, (points, _) in zip(starts, self.widths, self._rules, strict=True)
        ]
        return Instants(np.concatenate(local), plain.states, plain.controls, (rows[arc], rows[arc + 1]))

    def of(self, problem: OptimalControlProblem) -> Self:
        """See :class:`Transcription`: controls rest on bounds of ``problem``."""
        twin = super().of(problem)
        bounds = zip(self.problem.control_bounds, problem.control_bounds, strict=True)
        twin.pinned = {
            name: levels
            if before == after
            else np.select([levels == own for own in before], list(after), levels)
            for (name, levels), (before, after) in zip(self.pinned.items(), bounds, strict=True)
        }
        return twin

    def constrain_dynamics(self) -> None:
        """The defects of every arc, and the order of the arcs in time."""
        super().constrain_dynamics()
        rows = self.edge_rows()
        durations = sparse.csr_array(rows[1:] - rows[:-1])
        self.builder.constrain(fixed(_SHORTEST_ARC, np.inf), scale=self.scaling.time, linear=durations)
        self._bound_ends()

    def edges_of(self, trajectory: Trajectory) -> Vector:
        """The normalised ends of the arcs of a solution."""
        return np.array(trajectory.basis["breaks"])[self._first_segments]

    def gauss_tau(self, trajectory: Trajectory) -> Vector:
        """The Gauss nodes of a solution."""
        return np.delete(trajectory.nodes, self._starts)

    def by_segment(self, values: Vector) -> Vector:
        """For each segment the largest of values that belong to the gaps between its nodes and ends."""
        return np.asarray(np.maximum.reduceat(values, self._starts[:-1]), np.float64)

    def switching_functions(self, trajectory: Trajectory, bound_multipliers: Vector) -> Vector:
        """dH/du at the Gauss nodes, (m, K), from the (scaled) multipliers of the bounds of the unknowns.

        A change d of u_j at node k changes the optimum by w_k (tb - ta) (dH/du_j) d, which is what the bound
        of that node, or its pin, resists. So the terms of limits that are followed are in it too.
        """
        multipliers = -bound_multipliers / self.builder.scale * self.scaling.objective
        weights, blocks = self.node_weights(trajectory), self.builder.blocks["controls"]
        return np.array([multipliers[block.start : block.stop] / weights for block in blocks])

    def node_weights(self, trajectory: Trajectory) -> Vector:
        """The quadrature weights of the Gauss nodes over time."""
        shares = [width / 2.0 * rule[1] for width, rule in zip(self.widths, self._rules, strict=True)]
        lengths = trajectory.duration * np.diff(self.edges_of(trajectory))
        return np.asarray(np.concatenate(shares) * lengths[self.arc_of_node], np.float64)

    def read_breaks(self, unknowns: Vector) -> tuple[Vector, tuple[float, float]]:
        """The normalised breaks and (t0, tf) of a solution."""
        _, (t0, tf) = super().read_breaks(unknowns)
        inner = [(float(unknowns[block.start]) - t0) / (tf - t0) for block in self.builder.blocks["instants"]]
        edges = np.array([0.0, *inner, 1.0])
        starts = np.concatenate([part[:-1] for part in self.parts])
        arc = self.arc_of_segment
        return np.append(edges[arc] + starts * np.diff(edges)[arc], 1.0), (t0, tf)

    def _bound_ends(self) -> None:
        """Hold free controls and path constraints within bounds at both ends of the arcs, which are no nodes.

        Where an arc begins with a control that just leaves its bound, the nodes alone would let it begin
        earlier, with a control beyond the bound.
        """
        problem, arcs = self.problem, np.arange(len(self.parts))
        bounded = [
            (j, np.isnan(self.pinned[name]))
            for j, name in enumerate(problem.controls)
            if np.isfinite(problem.control_bounds[j]).any() and np.isnan(self.pinned[name]).any()
        ]
        for side in (0, 1) if bounded or problem.path else ():
            ends = self.at_arcs(arcs, side)
            for j, free in bounded:
                rows = ends.controls[j][free & ~np.isin(arcs, self.met_otherwise(j, side))]
                self.builder.constrain(_control_interval(j), scale=self.scaling.controls[j], linear=rows)
            if problem.path:
                self.hold_path(ends, lambda this: this.path_bounds_in(arcs))

    @cached_property
    def _first_segments(self) -> NDArray[np.intp]:
        """The first segment of every arc, and the number of segments."""
        return np.concatenate([[0], np.cumsum([len(part) - 1 for part in self.parts])])

    @property
    def arc_points(self) -> NDArray[np.intp]:
        """Among the points where states stand, the start of every arc and the end of the last."""
        return self._starts[self._first_segments]

    def at_arcs(self, arcs: Sequence[int] | NDArray[np.intp], side: int) -> Instants:
        """The instants at which arcs start (``side`` 0) or end (1), with the controls inside the arc."""
        arcs = np.asarray(arcs, np.intp)
        segments = self._first_segments[arcs] if side == 0 else self._first_segments[arcs + 1] - 1
        first_nodes, to_ends = np.concatenate([[0], np.cumsum(self.counts)]), self._to_ends()
        matrix = sparse.lil_array((arcs.size, self.node_tau.size))
        for row, segment in enumerate(segments):
            matrix[row, first_nodes[segment] : first_nodes[segment + 1]] = to_ends[segment][side]
        shares, edges = sparse.csr_array(matrix), self.edge_rows()
        blocks = self.builder.blocks
        return Instants(
            np.full(arcs.size, float(side)),
            [self.builder.rows_of(block)[self.arc_points[arcs + side]] for block in blocks["states"]],
            [self.builder.rows_of(block, shares) for block in blocks["controls"]],
            (edges[arcs], edges[arcs + 1]),
        )

    def edge_rows(self) -> sparse.csr_array:
        """Rows of the S + 1 ends of the arcs."""
        first, last = self.builder.blocks["times"]
        edges = [block.start for block in (first, *self.builder.blocks["instants"], last)]
        return self.builder.single_rows(np.array(edges))


def _control_interval(index: int) -> Intervals:
    return lambda this: this.problem.control_bounds[index]
