"""The numbers of a prediction: magnitudes, which stay, and what each segment wants anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Scales:
    """Magnitudes of driven states (n,), controls (m,), time and objective."""

    states: Vector
    controls: Vector
    time: float
    objective: float


@dataclass(frozen=True)
class Wanted:
    """What one prediction is asked for, with n driven states, m controls and K instants.

    ``start`` (n,) driven states, ``initial`` all states there, ``time`` when that is; ``numbers`` (., P) of
    the P places (`Mesh.places`); ``lower``, ``upper`` (n,): bounds of the driven states with their margins;
    ``segment_end``, ``horizon_end`` (n, 2): intervals of the driven states there; ``lengths`` (2, 2):
    intervals of d1 and d2; ``boundary`` (b, 2): intervals of the boundary constraints; ``guess``: states
    (n, K), controls (m, K), lengths (2,).
    """

    start: Vector
    initial: Sequence[float]
    time: float
    numbers: Vector
    lower: Vector
    upper: Vector
    segment_end: Vector
    horizon_end: Vector
    lengths: Vector
    boundary: Vector
    guess: tuple[Vector, Vector, Vector]
