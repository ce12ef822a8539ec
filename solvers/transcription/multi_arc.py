"""Multi-arc Gauss collocation: arcs between free instants, some of which follow limits.

On an arc that follows a limit S(x, t) = 0 of order q the program holds S^(q) = 0 at the nodes and
S = ... = S^(q-1) = 0 where the arc begins: with the index of the equations reduced beforehand the rows are
independent, and the limit decides a control at every node. Where a limit is only touched, S = S' = 0. Where
the control that decides meets the bound that leads through the limit, S^(q) = 0 with it on that bound.

Source: Bryson, Denham, Dreyfus, AIAA Journal 1(11), 1963.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from solvers.limits import Limit
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory
from solvers.transcription.builder import Places
from solvers.transcription.free_arcs import FreeArcs
from solvers.transcription.limit_rates import LimitRates
from solvers.transcription.nodes import Instants, NodeSymbols

Vector = NDArray[np.float64]

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

    @property
    def key(self) -> Hashable:
        """What of it enters matrices."""
        limit = self.limit.pointer, self.limit.upper
        return *limit, self.arcs, self.touched, self.idle, self.parted, self.tangent

    def met(self, side: int) -> list[int]:
        """The arcs that are ``parted`` on this side."""
        return [arc for arc, own in self.parted if own == side]


@dataclass
class MultiArc(FreeArcs):
    """Arcs of which some follow limits; ``follows``: the limits and their arcs."""

    follows: tuple[Follow, ...] = ()

    @property
    def mesh(self) -> Hashable:
        """Arcs, their nodes, and which of them follow limits."""
        return super().mesh, tuple(item.key for item in self.follows)

    def state_bounds(self, index: int, count: int) -> tuple[Vector, Vector]:
        """The bounds of the document, inside left out where the trajectory is held on them by equations."""
        sides = super().state_bounds(index, count)
        for item in self.follows:
            if item.limit.state == index:
                held = np.zeros(count, bool)
                for arc in (*item.arcs, *item.idle):
                    held[self.arc_points[arc] : self.arc_points[arc + 1] + 1] = True
                held[self.arc_points[list(item.touched)]] = True
                held[[0, -1]] = False  # there the end conditions hold
                sides[item.limit.upper][held] = np.inf if item.limit.upper else -np.inf
        return sides

    def path_bounds_in(self, arcs: NDArray[np.intp]) -> tuple[Vector, Vector]:
        """The bounds of the document, left out where the trajectory is held on them by equations."""
        sides = super().path_bounds_in(arcs)
        for item in self.follows:
            if item.limit.path is not None:
                side = sides[item.limit.upper].reshape(arcs.size, -1)
                side[np.isin(arcs, (*item.arcs, *item.idle)), item.limit.path] = (
                    np.inf if item.limit.upper else -np.inf
                )
        return sides

    def met_otherwise(self, control: int, side: int) -> Sequence[int]:
        """Where a control comes to its bound along a limit, the limit says where."""
        return [arc for item in self.follows if control in item.rates.controls for arc in item.met(side)]

    def of(self, problem: OptimalControlProblem) -> Self:
        """See :class:`Transcription`: arcs follow limits of ``problem``."""
        twin = super().of(problem)
        twin.follows = tuple(replace(item, limit=item.limit.of(problem)) for item in self.follows)
        return twin

    def constrain_dynamics(self) -> None:
        """The defects of every arc, the order of the arcs in time, and what follows limits."""
        super().constrain_dynamics()
        for index, item in enumerate(self.follows):
            self._follow(index, item)

    def nodes_following(self, item: Follow) -> NDArray[np.intp]:
        """Which of the Gauss nodes follow a limit."""
        return np.flatnonzero(np.isin(self.arc_of_node, item.arcs))

    def limit_multipliers(self, trajectory: Trajectory, row_multipliers: Vector) -> list[Vector]:
        """For each of ``follows`` the multiplier nu of S^(q) = 0, as in H + nu S^(q), at its nodes."""
        weights, found = self.node_weights(trajectory), []
        for index, item in enumerate(self.follows):
            nodes = self.nodes_following(item)
            adjoint = np.zeros(0)
            if nodes.size:
                adjoint = self.builder.adjoint(self.builder.places[f"limit {index}"], row_multipliers)
            found.append(adjoint * self.scaling.objective / weights[nodes])
        return found

    def _follow(self, index: int, item: Follow) -> None:
        """Hold S^(q) at the nodes of the arcs, and S ... S^(q-1) where the trajectory meets the limit."""
        order = item.rates.order
        along = self._hold(index, [order], _some(self.path_instants(), self.nodes_following(item)))
        if along is not None:
            self.builder.places[f"limit {index}"] = along
        entries = [arc for arc in item.arcs if arc > 0 and arc - 1 not in item.arcs]
        self._hold(index, range(order), self.at_arcs(entries, 0))
        self._hold(index, range(min(order, _TOUCHED)), self.at_arcs(item.touched, 0))
        self._hold(index, [order], self.at_arcs(item.tangent, 0))
        self._hold(index, [order], self.at_arcs([arc + 1 for arc in item.met(1)], 0))
        self._hold(index, [order], self.at_arcs([arc - 1 for arc in item.met(0)], 1))

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


def _some(instants: Instants, index: NDArray[np.intp]) -> Instants:
    assert instants.span is not None
    start, stop = instants.span
    return Instants(
        instants.tau[index],
        [rows[index] for rows in instants.states],
        [rows[index] for rows in instants.controls],
        (start[index], stop[index]),
    )
