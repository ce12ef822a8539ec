"""Modified equinoctial elements (p, f, g, h, k, L): regular for circular and equatorial orbits.

p: semi-latus rectum; (f, g) = e (cos, sin) of the longitude of perigee; (h, k) = tan(i/2) (cos, sin) of the
node; L: true longitude. Orbital axes here: x along track, y along the orbit normal, z radial.

Source: Walker, Ireland, Owens, "A set of modified equinoctial orbit elements", Celestial Mechanics 36, 1985.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from solvers.space.vectors import Triple, added, cross, dot, scaled

Functions = Mapping[str, Callable[..., Any]]


@dataclass(frozen=True)
class Axes:
    """Unit vectors of the orbital axes, in inertial components."""

    along: Triple
    normal: Triple
    radial: Triple

    def inertial(self, components: Triple) -> Triple:
        """The vector with these components along the orbital axes."""
        parts = zip(components, (self.along, self.normal, self.radial), strict=True)
        return added(*(scaled(value, axis) for value, axis in parts))

    def components(self, vector: Triple) -> Triple:
        """The components of an inertial vector along the orbital axes."""
        return dot(vector, self.along), dot(vector, self.normal), dot(vector, self.radial)


def axes_of(h: Any, k: Any, longitude: Any, functions: Functions) -> Axes:
    """The orbital axes at a true longitude."""
    s, c = functions["sin"](longitude), functions["cos"](longitude)
    to_f, to_g, normal = _plane(h, k)
    along = added(scaled(-s, to_f), scaled(c, to_g))
    return Axes(along, normal, added(scaled(c, to_f), scaled(s, to_g)))


def elements_of(
    position: Triple, velocity: Triple, gravity: Any, functions: Functions
) -> tuple[Any, Any, Any, Any, Any, Any]:
    """(p, f, g, h, k, L) of a position and velocity; L within (-pi, pi]; singular for i = pi."""
    radius = functions["sqrt"](dot(position, position))
    momentum = cross(position, velocity)
    square = dot(momentum, momentum)
    normal = scaled(1.0 / functions["sqrt"](square), momentum)
    h, k = -normal[1] / (1.0 + normal[2]), normal[0] / (1.0 + normal[2])
    to_f, to_g, _ = _plane(h, k)
    longitude = functions["atan2"](dot(position, to_g), dot(position, to_f))
    s, c = functions["sin"](longitude), functions["cos"](longitude)
    p = square / gravity
    e_cos = p / radius - 1.0
    e_sin = functions["sqrt"](p / gravity) * dot(position, velocity) / radius
    return p, e_cos * c + e_sin * s, e_cos * s - e_sin * c, h, k, longitude


def _plane(h: Any, k: Any) -> tuple[Triple, Triple, Triple]:
    """The equinoctial axes f and g in the plane of the orbit, and its normal."""
    factor = 1.0 / (1.0 + h * h + k * k)
    return (
        scaled(factor, (1.0 + h * h - k * k, 2.0 * h * k, -2.0 * k)),
        scaled(factor, (2.0 * h * k, 1.0 - h * h + k * k, 2.0 * h)),
        scaled(factor, (2.0 * k, -2.0 * h, 1.0 - h * h - k * k)),
    )
