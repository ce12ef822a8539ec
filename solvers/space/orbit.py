"""Gauss's variational equations in (a, Omega, i, ex, ey, phi), and the way to position and velocity.

a: semi-major axis; Omega: right ascension of the ascending node; i: inclination; (ex, ey) = e (cos w, sin w);
phi = w + M with the argument of perigee w and the mean anomaly M. Regular for circular orbits, singular for
equatorial ones, where Omega says nothing.

Source: Zhu, Shi, "Piecewise Parallel Optimal Algorithm", IntechOpen 2018, doi 10.5772/intechopen.76625 (whose
equations are lost; derived anew); Battin, An Introduction to the Mathematics and Methods of Astrodynamics,
AIAA 1999, 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.space.earth import GRAVITY

Vector = NDArray[np.float64]

_KEPLER_ITERATIONS = 12


@dataclass(frozen=True)
class _Place:
    """Where a satellite is on its orbit: q = sqrt(1 - e^2), argument of latitude u, e cos nu, e sin nu, r."""

    q: float
    u: float
    e_cos: float
    e_sin: float
    r: float


def gauss_rates(elements: Vector, acceleration: Vector) -> Vector:
    """Rates of (a, Omega, i, ex, ey, phi) in m, rad, s.

    ``acceleration``: (along track, orbit normal, radial) components of what perturbs, m/s^2.
    """
    a, _, i, ex, ey, _ = elements
    sx, sy, sz = acceleration
    place = _place(elements)
    q, r, su, cu = place.q, place.r, np.sin(place.u), np.cos(place.u)
    n = np.sqrt(GRAVITY / a**3)
    part = r / (a * q**2)
    node = sy * r * su / (n * a**2 * q * np.sin(i))
    turn = node * np.cos(i)
    factor = q / (n * a)
    late = sz * (2.0 * r / a + q / (1.0 + q) * place.e_cos) - sx * (1.0 + part) * q / (1.0 + q) * place.e_sin
    return np.array(
        [
            2.0 / (n * q) * (sz * place.e_sin + sx / part),
            node,
            sy * r * cu / (n * a**2 * q),
            factor * (sz * su + sx * ((1.0 + part) * cu + part * ex)) + turn * ey,
            factor * (-sz * cu + sx * ((1.0 + part) * su + part * ey)) - turn * ex,
            n - late / (n * a) - turn,
        ]
    )


def orbital_axes(position: Vector, velocity: Vector) -> Vector:
    """Unit vectors along track, along the orbit normal and radial, by rows (3, 3)."""
    radial = position / np.linalg.norm(position)
    normal = np.cross(position, velocity)
    normal /= np.linalg.norm(normal)
    return np.array([np.cross(normal, radial), normal, radial])


def cartesian(elements: Vector) -> tuple[Vector, Vector]:
    """Inertial position and velocity, m and m/s."""
    a, node, i, _, _, _ = elements
    place = _place(elements)
    su, cu, so, co, si, ci = (
        value for angle in (place.u, node, i) for value in (np.sin(angle), np.cos(angle))
    )
    radial = np.array([cu * co - su * so * ci, cu * so + su * co * ci, su * si])
    along = np.array([-su * co - cu * so * ci, -su * so + cu * co * ci, cu * si])
    speed = np.sqrt(GRAVITY / (a * place.q**2))
    return place.r * radial, speed * (place.e_sin * radial + (1.0 + place.e_cos) * along)


def _place(elements: Vector) -> _Place:
    a, _, _, ex, ey, phi = elements
    q = np.sqrt(1.0 - ex**2 - ey**2)
    anomaly = phi  # Kepler's equation for the eccentric argument of latitude w + E
    for _ in range(_KEPLER_ITERATIONS):
        miss = anomaly - ex * np.sin(anomaly) + ey * np.cos(anomaly) - phi
        anomaly -= miss / (1.0 - ex * np.cos(anomaly) - ey * np.sin(anomaly))
    s, c = np.sin(anomaly), np.cos(anomaly)
    across = (ex * s - ey * c) / (1.0 + q)
    x, y = c - ex + ey * across, s - ey - ex * across
    r = a * np.hypot(x, y)
    u = np.arctan2(y, x)
    return _Place(q, u, ex * np.cos(u) + ey * np.sin(u), ex * np.sin(u) - ey * np.cos(u), r)
