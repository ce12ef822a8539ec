"""Where Sun and Moon are, by series of low precision: some minutes of arc, which a perturbation asks for.

Source: Montenbruck, Gill, Satellite Orbits, Springer 2000, 3.3.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, pi, radians, sin
from typing import Any

Functions = Mapping[str, Callable[..., Any]]
Place = tuple[Any, Any, Any]

_OBLIQUITY = radians(23.43929111)
_ARCSECOND = pi / 648_000.0
_CENTURY = 36_525.0
_KILOMETRE = 1000.0

# Amplitude in seconds of arc, multiples of l, l', F, D: the Moon's longitude.
_LONGITUDE = (
    (22640, 1, 0, 0, 0), (769, 2, 0, 0, 0), (-4586, 1, 0, 0, -2), (2370, 0, 0, 0, 2), (-668, 0, 1, 0, 0),
    (-412, 0, 0, 2, 0), (-212, 2, 0, 0, -2), (-206, 1, 1, 0, -2), (192, 1, 0, 0, 2), (-165, 0, 1, 0, -2),
    (148, 1, -1, 0, 0), (-125, 0, 0, 0, 1), (-110, 1, 1, 0, 0), (-55, 0, 0, 2, -2),
)  # fmt: skip
# The same for its latitude, beside the leading term.
_LATITUDE = (
    (-526, 0, 0, 1, -2), (44, 1, 0, 1, -2), (-31, -1, 0, 1, -2), (-25, -2, 0, 1, 0), (-23, 0, 1, 1, -2),
    (21, -1, 0, 1, 0), (11, 0, -1, 1, -2),
)  # fmt: skip
# Amplitude in km, the same multiples: cosines of its distance.
_DISTANCE = (
    (-20905, 1, 0, 0, 0), (-3699, -1, 0, 0, 2), (-2956, 0, 0, 0, 2), (-570, 2, 0, 0, 0), (246, 2, 0, 0, -2),
    (-205, 0, 1, 0, -2), (-171, 1, 0, 0, 2), (-152, 1, 1, 0, -2),
)  # fmt: skip


def sun(days: Any, functions: Functions) -> Place:
    """The Sun from the Earth's centre along the axes of the equator of J2000, m; ``days`` from J2000."""
    century = days / _CENTURY
    anomaly = radians(1.0) * (357.5256 + 35_999.049 * century)
    s1, s2 = functions["sin"](anomaly), functions["sin"](2.0 * anomaly)
    longitude = radians(282.94) + anomaly + _ARCSECOND * (6892.0 * s1 + 72.0 * s2)
    distance = 1e6 * (149.619 - 2.499 * functions["cos"](anomaly) - 0.021 * functions["cos"](2.0 * anomaly))
    return _equatorial(longitude, None, distance * _KILOMETRE, functions)


def moon(days: Any, functions: Functions) -> Place:
    """The Moon from the Earth's centre along the axes of the equator of J2000, m; ``days`` from J2000."""
    t = days / _CENTURY
    mean = radians(1.0) * (218.31617 + 481_267.88088 * t - 1.3972 * t)
    arguments = [
        radians(1.0) * (start + rate * t)
        for start, rate in (
            (134.96292, 477_198.86753),
            (357.52543, 35_999.04944),
            (93.27283, 483_202.01873),
            (297.85027, 445_267.11135),
        )
    ]

    def series(table: tuple[tuple[int, ...], ...], wave: str) -> Any:
        return sum(
            amplitude
            * functions[wave](sum(k * argument for k, argument in zip(multiples, arguments, strict=True)))
            for amplitude, *multiples in table
        )

    shift = _ARCSECOND * series(_LONGITUDE, "sin")
    solar, node = arguments[1], arguments[2]
    turned = _ARCSECOND * (412.0 * functions["sin"](2.0 * node) + 541.0 * functions["sin"](solar))
    latitude = _ARCSECOND * (18520.0 * functions["sin"](node + shift + turned) + series(_LATITUDE, "sin"))
    distance = 385_000.0 + series(_DISTANCE, "cos")
    return _equatorial(mean + shift, latitude, distance * _KILOMETRE, functions)


def _equatorial(longitude: Any, latitude: Any | None, distance: Any, functions: Functions) -> Place:
    """From the ecliptic to the equator."""
    x, y = distance * functions["cos"](longitude), distance * functions["sin"](longitude)
    z: Any = 0.0
    if latitude is not None:
        across, z = functions["cos"](latitude), distance * functions["sin"](latitude)
        x, y = x * across, y * across
    return x, y * cos(_OBLIQUITY) - z * sin(_OBLIQUITY), y * sin(_OBLIQUITY) + z * cos(_OBLIQUITY)
