"""Multi-arc Gauss collocation: the instants between arcs are unknowns, controls rest on bounds along arcs.

Decision vector: the states and controls of the Gauss pseudospectral method, each arc made of one or more of
its segments, and

    s_1 ... s_(S-1) | t0 | tf        (s: the instants between the S arcs)

A node counts its time over its own arc, of which every segment is a fixed part. On an arc where a control is
pinned to a bound its nodes are fixed, so that the control switches exactly at s and is exactly on its bound
in between. On an arc that follows a limit S(x, t) = 0 of order q the program holds S^(q) = 0 at the nodes and
S = ... = S^(q-1) = 0 where the arc begins: with the index of the equations reduced beforehand the rows are
independent, and the limit decides a control at every node. Where a limit is only touched, S = S' = 0. Where
the control that decides meets the bound that leads through the limit, S^(q) = 0 with it on that bound.

Source: Betts, Practical Methods for Optimal Control, SIAM 2010, 3.7 (phases); Maurer, Buskens, Kim, Kaya,
"Optimization methods for the verification of second order sufficient conditions for bang-bang controls",
Optim. Control Appl. Meth. 26, 2005; Bryson, Denham, Dreyfus, AIAA Journal 1(11), 1963 (limits).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.limits import Limit
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.transcription.builder import Intervals, Places, fixed
from solvers.transcription.gauss_pseudospectral import GaussPseudospectral
from solvers.transcription.limit_rates import LimitRates
from solvers.transcription.nodes import Instants, NodeSymbols

Vector = NDArray[np.float64]

# An arc may shrink to nothing while the optimizer looks for the structure, but never run backwards.
_SHORTEST_ARC = 0.0
# Where a limit is touched no more than its value and its rate are known.
_TOUCHED = 2


@dataclass(frozen=True)
class Follow:
    """A limit with its rates, the arcs that follow it, and the arcs that start where it is touched.

    On each of the arcs one of the controls that decide must be free. ``idle``: arcs where all are pinned so
    that the limit is followed by itself; its bounds say nothing there and would have no definite multipliers.
    ``parted``: of the ``arcs``, each with a side (0: where it starts, 1: where it ends), those that meet an
    arc on which the control that decides rests on the bound that leads through the limit. It can only be
    reached along the limit: S^(q) = 0 with the control on that bound. ``tangent``: of the ``touched``, those
    where no control may jump: a limit of order 1 is then at its extreme, S = S' = 0.
    """

    limit: Limit
    rates: LimitRates
    arcs: tuple[int, ...]
    touched: tuple[int, ...] = ()
    idle: tuple[int, ...] = ()
    parted: tuple[tuple[int, int], ...] = ()
    tangent: tuple[int, ...] = ()

    def met(self, side: int) -> list[int]:
        """The arcs that are ``parted`` on this side."""
        return [arc for arc, own in self.parted if own == side]


@dataclass
class MultiArc(GaussPseudospectral):
    """Gauss collocation on segments between ``breaks``; the breaks where a new arc begins are free.

    ``parts``: for each arc the ends of its segments as parts of it, from 0 to 1; ``pinned``: for each
    control, by arc, the value it rests on, NaN where it is free; ``follows``: limits and their arcs.
    """

    parts: tuple[tuple[float, ...], ...]
    pinned: Mapping[str, Vector]
    follows: tuple[Follow, ...] = ()

    @property
    def widths(self) -> Vector:
        """The part of its arc that each segment takes."""
        return np.concatenate([np.diff(part) for part in self.parts])

    @property
    def mesh(self) -> Hashable:
        """Arcs and their nodes; where they start is for the optimizer to find."""
        free = tuple(tuple(np.isnan(levels).tolist()) for levels in self.pinned.values())
        bounded = tuple(bool(np.isfinite(bounds).any()) for bounds in self.problem.control_bounds)
        follows = tuple(
            (
                item.limit.pointer,
                item.limit.upper,
                item.arcs,
                item.touched,
                item.idle,
                item.parted,
                item.tangent,
            )
            for item in self.follows
        )
        return self.parts, self.counts, free, bounded, follows

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

    def state_bounds(self, index: int, count: int) -> tuple[Vector, Vector]:
        """The bounds of the document, inside left out where the trajectory is held on them by equations."""
        sides = super().state_bounds(index, count)
        for item in self.follows:
            if item.limit.state == index:
                held = np.zeros(count, bool)
                for arc in (*item.arcs, *item.idle):
                    held[self._points[arc] : self._points[arc + 1] + 1] = True
                held[self._points[list(item.touched)]] = True
                held[[0, -1]] = False  # there the end conditions hold
                sides[item.limit.upper][held] = np.inf if item.limit.upper else -np.inf
        return sides

    def path_bounds(self, count: int) -> tuple[Vector, Vector]:
        """The bounds of the document, left out where the trajectory is held on them by equations."""
        return self._path_bounds(self.arc_of_node)

    def _path_bounds(self, arcs: NDArray[np.intp]) -> tuple[Vector, Vector]:
        """The same at instants that belong to these arcs."""
        sides = super().path_bounds(arcs.size)
        for item in self.follows:
            if item.limit.path is not None:
                side = sides[item.limit.upper].reshape(arcs.size, -1)
                side[np.isin(arcs, (*item.arcs, *item.idle)), item.limit.path] = (
                    np.inf if item.limit.upper else -np.inf
                )
        return sides

    def path_instants(self) -> Instants:
        """The Gauss nodes, each with the span of its arc."""
        plain = super().path_instants()
        rows, arc = self._edge_rows(), self.arc_of_node
        starts = np.concatenate([part[:-1] for part in self.parts])
        local = [
            start + width * (points + 1.0) / 2.0
            for start, width, (points, _) in zip(starts, self.widths, self._rules, strict=True)
        ]
        return Instants(np.concatenate(local), plain.states, plain.controls, (rows[arc], rows[arc + 1]))

    def of(self, problem: OptimalControlProblem) -> Self:
        """See :class:`Transcription`: controls rest on bounds, and arcs follow limits, of ``problem``."""
        twin = super().of(problem)
        bounds = zip(self.problem.control_bounds, problem.control_bounds, strict=True)
        twin.pinned = {
            name: levels
            if before == after
            else np.select([levels == own for own in before], list(after), levels)
            for (name, levels), (before, after) in zip(self.pinned.items(), bounds, strict=True)
        }
        twin.follows = tuple(replace(item, limit=item.limit.of(problem)) for item in self.follows)
        return twin

    def constrain_dynamics(self) -> None:
        """The defects of every arc, the order of the arcs in time, and what follows limits."""
        super().constrain_dynamics()
        rows = self._edge_rows()
        durations = sparse.csr_array(rows[1:] - rows[:-1])
        self.builder.constrain(fixed(_SHORTEST_ARC, np.inf), scale=self.scaling.time, linear=durations)
        self._bound_ends()
        for index, item in enumerate(self.follows):
            self._follow(index, item)

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
        weights, blocks = self._node_weights(trajectory), self.builder.blocks["controls"]
        return np.array([multipliers[block.start : block.stop] / weights for block in blocks])

    def nodes_following(self, item: Follow) -> NDArray[np.intp]:
        """Which of the Gauss nodes follow a limit."""
        return np.flatnonzero(np.isin(self.arc_of_node, item.arcs))

    def limit_multipliers(self, trajectory: Trajectory, row_multipliers: Vector) -> list[Vector]:
        """For each of ``follows`` the multiplier nu of S^(q) = 0, as in H + nu S^(q), at its nodes."""
        weights, found = self._node_weights(trajectory), []
        for index, item in enumerate(self.follows):
            nodes = self.nodes_following(item)
            adjoint = np.zeros(0)
            if nodes.size:
                adjoint = self.builder.adjoint(self.builder.places[f"limit {index}"], row_multipliers)
            found.append(adjoint * self.scaling.objective / weights[nodes])
        return found

    def _node_weights(self, trajectory: Trajectory) -> Vector:
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
        earlier, with a control beyond the bound. Where it comes to its bound along a limit, the limit says
        where.
        """
        problem, arcs = self.problem, np.arange(len(self.parts))
        bounded = [
            (j, np.isnan(self.pinned[name]))
            for j, name in enumerate(problem.controls)
            if np.isfinite(problem.control_bounds[j]).any() and np.isnan(self.pinned[name]).any()
        ]
        for side in (0, 1) if bounded or problem.path else ():
            ends = self._at_arcs(arcs, side)
            for j, free in bounded:
                said = [arc for item in self.follows if j in item.rates.controls for arc in item.met(side)]
                rows = ends.controls[j][free & ~np.isin(arcs, said)]
                self.builder.constrain(_control_interval(j), scale=self.scaling.controls[j], linear=rows)
            if problem.path:
                self.hold_path(ends, lambda this: this._path_bounds(arcs))

    def _follow(self, index: int, item: Follow) -> None:
        """Hold S^(q) at the nodes of the arcs, and S ... S^(q-1) where the trajectory meets the limit."""
        order = item.rates.order
        along = self._hold(index, [order], _some(self.path_instants(), self.nodes_following(item)))
        if along is not None:
            self.builder.places[f"limit {index}"] = along
        entries = [arc for arc in item.arcs if arc > 0 and arc - 1 not in item.arcs]
        self._hold(index, range(order), self._at_arcs(entries, 0))
        self._hold(index, range(min(order, _TOUCHED)), self._at_arcs(item.touched, 0))
        self._hold(index, [order], self._at_arcs(item.tangent, 0))
        self._hold(index, [order], self._at_arcs([arc + 1 for arc in item.met(1)], 0))
        self._hold(index, [order], self._at_arcs([arc - 1 for arc in item.met(0)], 1))

    def _hold(self, index: int, orders: Sequence[int], instants: Instants) -> Places | None:
        """Hold derivatives of a limit: that of order 0 on the level, all others at zero; where it is held."""
        if not instants.tau.size or not orders:
            return None
        symbols = NodeSymbols(self.problem)
        values = self.follows[index].rates.at(symbols, orders)
        places = self.apply(symbols.function("limit", values), instants)

        def level(this: MultiArc) -> tuple[Vector, Vector]:
            values = [this.follows[index].limit.level if order == 0 else 0.0 for order in orders]
            both = np.tile(values, instants.tau.size)
            return both, both

        self.builder.constrain(level, scale=1.0, places=places)
        return places

    @cached_property
    def _first_segments(self) -> NDArray[np.intp]:
        """The first segment of every arc, and the number of segments."""
        return np.concatenate([[0], np.cumsum([len(part) - 1 for part in self.parts])])

    @property
    def _points(self) -> NDArray[np.intp]:
        """Among the points where states stand, the start of every arc and the end of the last."""
        return self._starts[self._first_segments]

    def _at_arcs(self, arcs: Sequence[int] | NDArray[np.intp], side: int) -> Instants:
        """The instants at which arcs start (``side`` 0) or end (1), with the controls inside the arc."""
        arcs = np.asarray(arcs, np.intp)
        segments = self._first_segments[arcs] if side == 0 else self._first_segments[arcs + 1] - 1
        first_nodes, to_ends = np.concatenate([[0], np.cumsum(self.counts)]), self._to_ends()
        matrix = sparse.lil_array((arcs.size, self.node_tau.size))
        for row, segment in enumerate(segments):
            matrix[row, first_nodes[segment] : first_nodes[segment + 1]] = to_ends[segment][side]
        shares, edges = sparse.csr_array(matrix), self._edge_rows()
        blocks = self.builder.blocks
        return Instants(
            np.full(arcs.size, float(side)),
            [self.builder.rows_of(block)[self._points[arcs + side]] for block in blocks["states"]],
            [self.builder.rows_of(block, shares) for block in blocks["controls"]],
            (edges[arcs], edges[arcs + 1]),
        )

    def _edge_rows(self) -> sparse.csr_array:
        """Rows of the S + 1 ends of the arcs."""
        first, last = self.builder.blocks["times"]
        edges = [block.start for block in (first, *self.builder.blocks["instants"], last)]
        return self.builder.single_rows(np.array(edges))


def _control_interval(index: int) -> Intervals:
    return lambda this: this.problem.control_bounds[index]


def _some(instants: Instants, index: NDArray[np.intp]) -> Instants:
    assert instants.span is not None
    start, stop = instants.span
    return Instants(
        instants.tau[index],
        [rows[index] for rows in instants.states],
        [rows[index] for rows in instants.controls],
        (start[index], stop[index]),
    )
