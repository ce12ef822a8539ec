"""A flight as pieces of the control, one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_ROUNDING = 1e-12


@dataclass(frozen=True)
class Pieces:
    """N pieces of a flight.

    ``times`` (N + 1,), ``states`` (N + 1, n) of the plant, ``seen`` (., N + 1) those of the problem,
    ``costs`` (N + 1,) the running cost so far; ``before`` and ``after`` (N, m): the control where a piece
    begins and where it ends, in the order of the problem; ``held`` (N, .): what the plant held.
    """

    times: Vector
    states: Vector
    seen: Vector
    costs: Vector
    before: Vector
    after: Vector
    held: Vector

    def until(self, end: float) -> Pieces:
        """The pieces that are over by then, but for rounding."""
        count = int(np.searchsorted(self.times, end + _ROUNDING * abs(end), side="right")) - 1
        return Pieces(
            self.times[: count + 1],
            self.states[: count + 1],
            self.seen[:, : count + 1],
            self.costs[: count + 1],
            self.before[:count],
            self.after[:count],
            self.held[:count],
        )
