"""The Earth: its constants and shape, how it turns, and what its oblateness adds to gravity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import atan2, cos, hypot, radians, sin, sqrt
from typing import Any

from solvers.space.harmonics import gradient

Functions = Mapping[str, Callable[..., Any]]
Triple = tuple[Any, Any, Any]

GRAVITY = 3.986004418e14
"""Gravitational parameter, m^3/s^2."""
EQUATORIAL_RADIUS = 6_378_137.0
"""Equatorial radius of WGS 84, m."""
ZONAL = {2: 1.08262668e-3, 3: -2.53265649e-6, 4: -1.61962159e-6}
"""Zonal harmonics J_n of EGM96, without normalisation."""
ROTATION_RATE = 7.2921158553e-5
"""Rate of rotation, rad/s."""

_FLATTENING = 1.0 / 298.257223563
_ITERATIONS = 4  # each gains three digits at the height of a satellite


def sidereal_angle(days: float) -> float:
    """Greenwich mean sidereal time ``days`` after J2000 (UT1), rad; not wrapped."""
    return radians(280.46061837 + 360.98564736629 * days)


def turned(vector: Triple, angle: Any, functions: Functions) -> Triple:
    """The components of a vector along axes that are turned by ``angle`` about z."""
    x, y, z = vector
    s, c = functions["sin"](angle), functions["cos"](angle)
    return c * x + s * y, c * y - s * x, z


def zonal_acceleration(zonal: Mapping[int, float], x: Any, y: Any, z: Any) -> Triple:
    """What the zonal harmonics J_n add to the central gravity of the Earth, m/s^2; z is its axis."""
    terms = [(n, 0, -value, 0.0) for n, value in zonal.items()]
    scale = GRAVITY / EQUATORIAL_RADIUS**2
    ax, ay, az = gradient(terms, EQUATORIAL_RADIUS, x, y, z)
    return scale * ax, scale * ay, scale * az


def geodetic_height(x: float, y: float, z: float) -> tuple[float, float]:
    """Height above the ellipsoid, m, and geodetic latitude, rad, of a place along the Earth's axes."""
    e2 = _FLATTENING * (2.0 - _FLATTENING)
    across = hypot(x, y)
    latitude, normal = atan2(z, across * (1.0 - e2)), EQUATORIAL_RADIUS
    for _ in range(_ITERATIONS):
        normal = EQUATORIAL_RADIUS / sqrt(1.0 - e2 * sin(latitude) ** 2)
        latitude = atan2(z + e2 * normal * sin(latitude), across)
    # Good at the poles as well as at the equator.
    height = across * cos(latitude) + z * sin(latitude) - EQUATORIAL_RADIUS**2 / normal
    return height, latitude
