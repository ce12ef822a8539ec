"""The unknowns of a prediction, and how to address them.

Decision vector, n driven states, m controls, K instants (`solvers.piecewise.mesh`):

    x_i: node 0, middle 0, node 1, ...        (a row for each driven state)
    u_j: the same instants
    s_b: at the soft instants, how far a bounded state is outside
    d1, d2: lengths of the segment and of the rest
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from solvers.piecewise.mesh import Indices, Mesh, Vector
from solvers.piecewise.simple import SimpleModel
from solvers.piecewise.wanted import Scales, Wanted
from solvers.transcription.builder import Matrix, ProgramBuilder, fixed


@dataclass
class Layout:
    """Blocks of unknowns named states, controls, outside and lengths in a builder."""

    model: SimpleModel
    mesh: Mesh
    scales: Scales
    builder: ProgramBuilder = field(default_factory=ProgramBuilder, init=False)

    @property
    def bounded(self) -> list[int]:
        """Driven states with bounds (their places among the driven)."""
        bounds = self.model.problem.state_bounds
        return [place for place, index in enumerate(self.model.driven) if np.isfinite(bounds[index]).any()]

    def allocate(self) -> None:
        """Append the unknowns."""
        builder, scales, instants = self.builder, self.scales, self.mesh.instants
        builder.unknowns(
            "states",
            (scales.states.size, instants),
            scale=scales.states,
            initial=lambda this: this.guess[0],
            bounds=self._state_bounds,
        )
        controls = np.array(self.model.problem.control_bounds, np.float64).reshape(-1, 2)
        builder.unknowns(
            "controls",
            (scales.controls.size, instants),
            scale=scales.controls,
            initial=lambda this: this.guess[1],
            bounds=lambda _: (controls[:, :1], controls[:, 1:]),
        )
        builder.unknowns(
            "outside",
            (len(self.bounded), self.mesh.soft),
            scale=scales.states[self.bounded],
            initial=lambda _: 0.0,
            bounds=fixed(0.0, np.inf),
        )
        builder.unknowns(
            "lengths",
            (2, 1),
            scale=scales.time,
            initial=lambda this: this.guess[2][:, None],
            bounds=lambda this: (this.lengths[:, :1], this.lengths[:, 1:]),
        )

    def _state_bounds(self, this: Wanted) -> tuple[Vector, Vector]:
        """Bounds after the soft instants, the start, and what is given where segment and horizon end."""
        free = np.full((this.start.size, self.mesh.instants), np.inf)
        lower, upper = -free, free.copy()
        hard = slice(self.mesh.soft + 1, None)
        lower[:, hard], upper[:, hard] = this.lower[:, None], this.upper[:, None]
        lower[:, 0] = upper[:, 0] = this.start
        for instant, ends in ((self.mesh.boundary, this.segment_end), (-1, this.horizon_end)):
            lower[:, instant] = np.maximum(lower[:, instant], ends[:, 0])
            upper[:, instant] = np.minimum(upper[:, instant], ends[:, 1])
        return lower, upper

    def rows(self, name: str, instants: Indices) -> list[Matrix]:
        """For each block of unknowns its rows at these instants."""
        return [self.builder.single_rows(block.start + instants) for block in self.builder.blocks[name]]

    def spans(self) -> list[Matrix]:
        """Rows of the time before a place's part, and of the length of that part."""
        builder = self.builder
        _, part = self.mesh.places
        first, second = (block.start for block in builder.blocks["lengths"])
        later = np.flatnonzero(part)
        before = sparse.csr_array(
            (np.ones(later.size), (later, np.full(later.size, first))), shape=(part.size, builder.size)
        )
        return [before, builder.single_rows(np.where(part == 0, first, second))]
