"""What the simple model of the electrodynamic tether and its plant share: parameters and magnetic field."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from solvers.models.library_model import Parameter
from solvers.space.earth import ROTATION_RATE, sidereal_angle, turned
from solvers.space.igrf import MagneticField
from solvers.space.vectors import Triple, dot, scaled

Functions = Mapping[str, Callable[..., Any]]

_POSITIVE = (1e-12, 1e12)
_SHARE = (0.0, 1.0)

TETHER = {
    "m1": Parameter(5.0, "kg", "mass of the main satellite, above", _POSITIVE),
    "m2": Parameter(1.75, "kg", "mass of the sub-satellite, below", _POSITIVE),
    "mt": Parameter(0.25, "kg", "mass of the tether", _POSITIVE),
    "L": Parameter(500.0, "m", "length of the tether", _POSITIVE),
    "zeta": Parameter(
        0.5, "1", "first moment of the current along the tether over I L^2; 1/2 if it is constant"
    ),
    "mass": Parameter("m1 + m2 + mt", "kg", "mass of the whole; follows from its parts"),
    "reduced": Parameter(
        "(m1*m2 + (m1 + m2)*mt/3 + mt^2/12)/mass", "kg", "moment of inertia over L^2; follows from the masses"
    ),
    "offset": Parameter(
        "zeta - (m1 + mt/2)/mass", "1", "from the centre of mass to that of the current, over L; follows"
    ),
}
"""Parameters of the tether."""

SURROUNDINGS = {
    "igrf": Parameter(
        1.0, "1", "magnetic field: 1 for IGRF, 0 for a dipole along the axis of the Earth", _SHARE
    ),
    "degree": Parameter(7.0, "1", "degree of IGRF", (1.0, 13.0)),
    "B0": Parameter(29_619.0e-9, "T", "dipole: field on the equator at the distance R0"),
    "R0": Parameter(6_371_200.0, "m", "dipole: the distance of B0", _POSITIVE),
    "epoch": Parameter(0.0, "d", "days from J2000, 2000-01-01 12:00, at t = 0", (-36_000.0, 10_900.0)),
    "sidereal": Parameter(0.0, "rad", "added to the Earth's angle of rotation, to start elsewhere"),
    "oblateness": Parameter(1.0, "1", "1 with the oblateness of the Earth, 0 without", _SHARE),
}
"""Parameters of where it flies."""


def field_at(parameters: Mapping[str, float]) -> Callable[[Triple, Any, Functions], Triple]:
    """B in T along inertial axes as a function of the place in m and the time in s."""
    share, b0, r0 = parameters["igrf"], parameters["B0"], parameters["R0"]
    start = sidereal_angle(parameters["epoch"]) + parameters["sidereal"]
    igrf = MagneticField.at(parameters["epoch"], round(parameters["degree"]))

    def dipole(place: Triple) -> Triple:
        square = dot(place, place)
        strength = b0 * r0**3 / square**1.5
        x, y, z = scaled(-3.0 * strength * place[2] / square, place)
        return x, y, z + strength

    def field(place: Triple, time: Any, functions: Functions) -> Triple:
        if share == 0.0:
            return dipole(place)
        angle = start + ROTATION_RATE * time
        real = turned(igrf(*turned(place, angle, functions)), -angle, functions)
        if share == 1.0:
            return real
        mixed = zip(real, dipole(place), strict=True)
        x, y, z = (share * a + (1.0 - share) * b for a, b in mixed)
        return x, y, z

    return field
