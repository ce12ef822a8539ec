"""The program of a prediction: one segment on its own mesh, then the rest of the horizon on another.

Hermite-Simpson defects on every interval. The segment begins where the plant will be, which may be outside
the bounds: at the first instants they are soft. Lengths are fixed, or free with a state that is given at the
ends of both parts. One structure serves all segments alike; what changes is numbers.

Source: Zhu, Shi, "Piecewise Parallel Optimal Algorithm", IntechOpen 2018, doi 10.5772/intechopen.76625.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solvers.piecewise.defects import add_dynamics, add_path
from solvers.piecewise.ends import add_ends
from solvers.piecewise.layout import Layout
from solvers.piecewise.mesh import Mesh
from solvers.piecewise.prices import smooth, soften
from solvers.piecewise.simple import SimpleModel
from solvers.piecewise.wanted import Scales, Wanted
from solvers.program import NonlinearProgram

Vector = NDArray[np.float64]


@dataclass
class Horizon:
    """The program on a mesh; ``smoothing`` is the weight of squared steps of the controls."""

    model: SimpleModel
    mesh: Mesh
    scales: Scales
    smoothing: float
    _layout: Layout = field(init=False)

    def __post_init__(self) -> None:
        self._layout = Layout(self.model, self.mesh, self.scales)

    @property
    def size(self) -> tuple[int, int]:
        """The numbers of unknowns and of rows, once there is a program."""
        return self._layout.builder.size, self._layout.builder.row_count

    def program(self, wanted: Wanted) -> NonlinearProgram:
        """The scaled program for these numbers."""
        layout = self._layout
        if not layout.builder.size:
            layout.allocate()
            add_dynamics(layout)
            soften(layout)
            add_path(layout)
            add_ends(layout)
            smooth(layout, self.smoothing)
        return layout.builder.program(wanted, self.scales.objective)

    def read(self, unknowns: Vector) -> tuple[Vector, Vector, Vector]:
        """States (n, K), controls (m, K) and lengths (2,) of a (scaled) solution."""
        builder, instants = self._layout.builder, self.mesh.instants
        values = unknowns * builder.scale
        states, controls, lengths = (
            np.array([values[block.start : block.stop] for block in builder.blocks[name]])
            for name in ("states", "controls", "lengths")
        )
        return states.reshape(-1, instants), controls.reshape(-1, instants), lengths.ravel()
