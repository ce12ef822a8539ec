"""The International Geomagnetic Reference Field.

    U = a sum_n sum_m (a/r)^(n+1) (g_nm cos m l + h_nm sin m l) P_nm(sin phi),      B = -grad U

Source: Alken et al., "International Geomagnetic Reference Field: the thirteenth generation", Earth, Planets
and Space 73, 2021; coefficients: IGRF-14, IAGA, doi 10.5281/zenodo.14012302 (``data/IGRF14.shc``, CC BY 4.0).
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from functools import cache, cached_property
from importlib.resources import files
from math import factorial, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.space.harmonics import Term, gradient

Vector = NDArray[np.float64]

REFERENCE_RADIUS = 6_371_200.0
"""The radius a to which the coefficients belong, m."""
HIGHEST_DEGREE = 13

_J2000 = datetime(2000, 1, 1, 12)
_TESLA = 1e-9


@dataclass(frozen=True)
class MagneticField:
    """Gauss coefficients of a date, ``g`` and ``h`` (degree + 1, degree + 1), nT, Schmidt semi-normalised."""

    g: Vector
    h: Vector

    @classmethod
    def at(cls, days: float, degree: int = HIGHEST_DEGREE) -> MagneticField:
        """The field ``days`` from J2000, between two epochs linearly in time.

        Raises ValueError outside 1900 to 2030 and for a degree that is not within 1 to 13.
        """
        if not 1 <= degree <= HIGHEST_DEGREE:
            raise ValueError(f"the degree must be within 1 to {HIGHEST_DEGREE}, not {degree}")
        epochs, g, h = _table()
        if not epochs[0] <= days <= epochs[-1]:
            raise ValueError(f"IGRF-14 holds from 1900 to 2030, not {days:g} days from J2000")
        after = int(np.clip(np.searchsorted(epochs, days), 1, epochs.size - 1))
        part = (days - epochs[after - 1]) / (epochs[after] - epochs[after - 1])
        size = degree + 1
        now = [(1.0 - part) * table[after - 1] + part * table[after] for table in (g, h)]
        return cls(now[0][:size, :size], now[1][:size, :size])

    def __call__(self, x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
        """B in T along the axes of the rotating Earth, at a place in m along these."""
        ux, uy, uz = gradient(self._terms, REFERENCE_RADIUS, x, y, z)
        return -ux, -uy, -uz

    @cached_property
    def _terms(self) -> list[Term]:
        """n, m and the coefficients of harmonics that are not normalised, in T."""
        terms = []
        for n in range(1, self.g.shape[0]):
            for m in range(n + 1):
                schmidt = _TESLA * sqrt((1 if m == 0 else 2) * factorial(n - m) / factorial(n + m))
                terms.append((n, m, schmidt * float(self.g[n, m]), schmidt * float(self.h[n, m])))
        return terms


@cache
def _table() -> tuple[Vector, Vector, Vector]:
    """Epochs in days from J2000, and for each of them g and h, (epochs, 14, 14)."""
    text = (files("solvers.space") / "data" / "IGRF14.shc").read_text(encoding="ascii")
    lines = [line.split() for line in text.splitlines() if not line.startswith("#")]
    years = [datetime(int(float(year)), 1, 1) for year in lines[1]]
    epochs = np.array([(year - _J2000).total_seconds() / 86_400.0 for year in years])
    g, h = np.zeros((2, epochs.size, HIGHEST_DEGREE + 1, HIGHEST_DEGREE + 1))
    for degree, order, *values in lines[2:]:
        table = g if int(order) >= 0 else h
        table[:, int(degree), abs(int(order))] = [float(value) for value in values]
    return epochs, g, h
