"""Where the nodes of a prediction are: a segment's own, then those of what it sees after it.

Nodes and middles of all intervals in turn are the *instants*. The dynamics are evaluated at *places*: every
instant once, the boundary between both parts twice, because there its length is that of the one or the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Mesh:
    """``nodes`` intervals of a segment and ``rest`` after it, which may be none.

    Bounds are soft at the ``soft`` instants after the start.
    """

    nodes: int
    rest: int
    soft: int

    def softened(self) -> Mesh:
        """The same with soft bounds everywhere."""
        return replace(self, soft=self.instants - 1)

    @property
    def instants(self) -> int:
        """The number K of nodes and middles."""
        return 2 * (self.nodes + self.rest) + 1

    @property
    def boundary(self) -> int:
        """The instant at which the segment ends."""
        return 2 * self.nodes

    @property
    def soft_instants(self) -> Indices:
        """The instants with soft bounds."""
        return np.arange(1, self.soft + 1)

    @property
    def left_instants(self) -> Indices:
        """The node at which each interval begins."""
        return np.arange(0, self.instants - 1, 2)

    @property
    def places(self) -> tuple[Indices, Indices]:
        """For each place its instant and its part, 0 or 1."""
        first = np.arange(self.boundary + 1)
        second = np.arange(self.boundary, self.instants) if self.rest else first[:0]
        return np.concatenate([first, second]), np.repeat([0, 1], [first.size, second.size])

    @property
    def place_of_instant(self) -> Indices:
        """For each instant its place; the boundary's is that of the segment."""
        instants = np.arange(self.instants)
        return instants + (instants > self.boundary)

    @property
    def local(self) -> Vector:
        """For each place its time over the length of its part, from 0 to 1."""
        parts = [np.linspace(0.0, 1.0, 2 * count + 1) for count in (self.nodes, self.rest) if count]
        return np.concatenate(parts)

    def times_of_places(self, lengths: Vector) -> Vector:
        """For each place its time after the start, where the parts have these ``lengths`` (2,)."""
        _, part = self.places
        return np.asarray(np.where(part == 0, 0.0, lengths[0]) + self.local * lengths[part], np.float64)

    def times(self, lengths: Vector) -> Vector:
        """For each instant its time after the start, (K,)."""
        return self.times_of_places(lengths)[self.place_of_instant]
