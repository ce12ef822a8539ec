"""What goes from the predictor to the tracker: one segment of the reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.status import SolveStatus

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Reference:
    """A predicted segment at its nodes and middles, K = 2 nodes + 1 instants in turn.

    ``times`` (K,), ``states`` (n, K) all states of the simple model, ``controls`` (m, K), ``numbers`` (., K):
    what is known of an instant beforehand (`SimpleModel.beforehand`). ``seconds`` is what the prediction
    took, ``iterations``, ``variables`` and ``constraints`` are of its program.
    """

    index: int
    times: Vector
    states: Vector
    controls: Vector
    numbers: Vector
    objective: float
    status: SolveStatus
    solver_status: str
    iterations: int
    variables: int
    constraints: int
    seconds: float = 0.0

    @property
    def end(self) -> Vector:
        """All states at the end of the segment."""
        return np.asarray(self.states[:, -1], np.float64)
