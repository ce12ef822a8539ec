"""A flight as pieces of the control, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.piecewise.track import Track

Vector = NDArray[np.float64]


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

    @classmethod
    def of(cls, tracks: Sequence[Track], held: Sequence[Vector]) -> Pieces:
        """Tracked segments as one flight; where one ends the next begins."""
        first = tracks[0]
        states = np.vstack([first.states[:1], *[track.states[1:] for track in tracks]])
        return cls(
            np.concatenate([first.times[:1], *[track.times[1:] for track in tracks]]),
            states[:, :-1],
            np.hstack([first.seen[:, :1], *[track.seen[:, 1:] for track in tracks]]),
            states[:, -1],
            np.vstack([track.before for track in tracks]),
            np.vstack([track.after for track in tracks]),
            np.vstack(held),
        )
