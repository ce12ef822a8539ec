"""Multi-arc Gauss collocation: the instants between arcs are unknowns, controls rest on bounds along arcs.

Decision vector: the states and controls of the Gauss pseudospectral method with the arcs as its segments, and

    s_1 ... s_(S-1) | t0 | tf        (s: the instants between the S arcs)

A node counts its time over its own arc; on an arc where a control is pinned to a bound its nodes are fixed,
so that the control switches exactly at s and is exactly on its bound in between.

Source: Betts, Practical Methods for Optimal Control, SIAM 2010, 3.7 (phases); Maurer, Buskens, Kim, Kaya,
"Optimization methods for the verification of second order sufficient conditions for bang-bang controls",
Optim. Control Appl. Meth. 26, 2005.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.transcription.base import Instants
from solvers.transcription.builder import fixed
from solvers.transcription.gauss_pseudospectral import GaussPseudospectral

Vector = NDArray[np.float64]

# An arc may shrink to nothing while the optimizer looks for the structure, but never run backwards.
_SHORTEST_ARC = 0.0


@dataclass
class MultiArc(GaussPseudospectral):
    """Gauss collocation on arcs that start at the normalised instants ``breaks``, which are free.

    ``pinned``: for each control, by arc, the value it rests on; NaN where it is free.
    """

    pinned: Mapping[str, Vector]

    @property
    def widths(self) -> Vector:
        """Every node counts over its own arc."""
        return np.ones(len(self.counts))

    @property
    def mesh(self) -> Hashable:
        """Numbers of nodes; where the arcs start is for the optimizer to find."""
        return self.counts

    def allocate(self) -> None:
        """See :class:`Transcription`."""
        super().allocate()
        self.builder.unknowns(
            "instants",
            (len(self.counts) - 1, 1),
            scale=self.scaling.time,
            initial=lambda this: (this.start.t0 + (this.start.tf - this.start.t0) * this.breaks[1:-1])[
                :, None
            ],
            bounds=fixed(-np.inf, np.inf),
        )

    def control_bounds(self) -> tuple[Vector, Vector]:
        """The bounds of the document, or the pinned value twice."""
        lower, upper = super().control_bounds()
        rows = [np.repeat(self.pinned[name], self.counts) for name in self.problem.controls]
        pinned = np.array(rows).reshape(-1, self.node_tau.size)
        free = np.isnan(pinned)
        return np.where(free, lower, pinned), np.where(free, upper, pinned)

    def path_instants(self) -> Instants:
        """The Gauss nodes, each with the span of its arc."""
        plain = super().path_instants()
        rows = sparse.csr_array(sparse.vstack(self._edges(), format="csr"))
        arc = np.repeat(np.arange(len(self.counts)), self.counts)
        local = np.concatenate([(points + 1.0) / 2.0 for points, _ in self._rules])
        return Instants(local, plain.states, plain.controls, (rows[arc], rows[arc + 1]))

    def constrain_dynamics(self) -> None:
        """The defects of every arc, and the order of the arcs in time."""
        super().constrain_dynamics()
        durations = [after - before for before, after in pairwise(self._edges())]
        self.builder.constrain(
            fixed(_SHORTEST_ARC, np.inf),
            scale=self.scaling.time,
            linear=sparse.csr_array(sparse.vstack(durations, format="csr")),
        )

    def read_breaks(self, unknowns: Vector) -> tuple[Vector, tuple[float, float]]:
        """The normalised breaks and (t0, tf) of a solution."""
        _, (t0, tf) = super().read_breaks(unknowns)
        inner = [(float(unknowns[block.start]) - t0) / (tf - t0) for block in self.builder.blocks["instants"]]
        return np.array([0.0, *inner, 1.0]), (t0, tf)

    def _edges(self) -> list[sparse.csr_array]:
        """Rows of the ends of the arcs, in order."""
        first, last = self.builder.blocks["times"]
        return [self.builder.rows_of(edge) for edge in (first, *self.builder.blocks["instants"], last)]
