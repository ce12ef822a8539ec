"""The density of the upper atmosphere by NRLMSIS 2.1, with solar and magnetic indices that are given.

Given indices also mean that pymsis never looks for any on the network.

Source: Emmert et al., "NRLMSIS 2.1", J. Geophys. Res. Space Physics 127, 2022; pymsis.
"""

from __future__ import annotations

from math import atan2, degrees

import numpy as np

from solvers.space.earth import geodetic_height

_J2000 = np.datetime64("2000-01-01T12:00:00")


def density(place: tuple[float, float, float], days: float, f107: float, ap: float) -> float:
    """Total mass density, kg/m^3, at a place in m along the axes of the rotating Earth.

    ``days`` from J2000; ``f107``: solar flux at 10.7 cm of the day and its mean, in solar flux units; ``ap``:
    the planetary magnetic index.
    """
    import pymsis  # its Fortran library is loaded where a flight needs it

    x, y, z = place
    height, latitude = geodetic_height(x, y, z)
    when = _J2000 + np.timedelta64(round(days * 86_400_000.0), "ms")
    output = pymsis.calculate(
        when, degrees(atan2(y, x)), degrees(latitude), height / 1000.0, [f107], [f107], [[ap] * 7]
    )
    return float(output[..., pymsis.Variable.MASS_DENSITY].item())
