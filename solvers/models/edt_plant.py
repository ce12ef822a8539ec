"""An electrodynamic tether with all that moves it: the plant on which predictions of ``edt`` are tracked.

Centre of mass in inertial axes: central gravity with J2 to J4, the force I L e x B, drag of both satellites
and the tether in an atmosphere that turns with the Earth, Sun and Moon, radiation pressure outside the
Earth's shadow (a cylinder). The tether's unit vector e needs no angles and is regular on every orbit:

    e'' = -|e'|^2 e + 3 mu/r^3 (r^.e) [r^ - (r^.e) e] + offset I/reduced e x B + drag/(reduced L)

Density and sunlight change slowly and are held over a step.

Source: Montenbruck, Gill, Satellite Orbits, Springer 2000, chapter 3 (perturbations).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import pi
from typing import Any

from solvers.models.computed import Computed
from solvers.models.library_model import LibraryModel, Parameter, Quantity, View
from solvers.models.tether import SURROUNDINGS, TETHER, field_at
from solvers.space.atmosphere import density
from solvers.space.earth import (
    EQUATORIAL_RADIUS,
    GRAVITY,
    ROTATION_RATE,
    ZONAL,
    sidereal_angle,
    turned,
    zonal_acceleration,
)
from solvers.space.equinoctial import axes_of, elements_of
from solvers.space.sun_moon import moon, sun
from solvers.space.vectors import Triple, added, cross, dot, scaled

Functions = Mapping[str, Callable[..., Any]]
Values = Mapping[str, Any]

_PLACE, _SPEED = ("x", "y", "z"), ("vx", "vy", "vz")
_TETHER, _TETHER_RATE = ("ex", "ey", "ez"), ("wx", "wy", "wz")
_FORCED, _TURNED = ("ax", "ay", "az"), ("bx", "by", "bz")
_STATES = (*_PLACE, *_SPEED, *_TETHER, *_TETHER_RATE)

_SUN_GRAVITY, _MOON_GRAVITY = 1.32712440018e20, 4.902800066e12
_RADIATION_PRESSURE = 4.56e-6  # N/m^2 at the Earth's distance from the Sun
_DAY = 86_400.0
# Faces across the motion: of the cubes 0.2 x 0.2 x 0.2 m and 0.1 x 0.17 x 0.1 m.
_UPPER_FACE, _LOWER_FACE = 0.04, 0.017


def _triple(values: Values, names: tuple[str, str, str]) -> Triple:
    return values[names[0]], values[names[1]], values[names[2]]


def _formulas(parameters: Mapping[str, float]) -> list[Computed]:
    numbers = f"{dict(parameters)}"
    motion = frozenset({*_STATES, "I", "t", "rho", "sunlight"})
    return [
        Computed(
            ("rho", "sunlight"),
            frozenset({*_PLACE, "t"}),
            _weather(parameters),
            f"weather {numbers}",
            held=True,
        ),
        Computed((*_FORCED, *_TURNED), motion, _motion(parameters), f"motion {numbers}"),
    ]


def _weather(parameters: Mapping[str, float]) -> Callable[[Values, Functions], tuple[float, float]]:
    """Density of the atmosphere, kg/m^3, and 1 in the sunlight, 0 in the shadow."""
    epoch, start = parameters["epoch"], sidereal_angle(parameters["epoch"]) + parameters["sidereal"]

    def weather(values: Values, functions: Functions) -> tuple[float, float]:
        place, time = _triple(values, _PLACE), values["t"]
        days = epoch + time / _DAY
        rho = sunlight = 0.0
        if parameters["drag"]:
            fixed = turned(place, start + ROTATION_RATE * time, functions)
            rho = parameters["drag"] * density(fixed, days, parameters["F107"], parameters["Ap"])
        if parameters["radiation"]:
            to_sun = sun(days, functions)
            towards = dot(place, to_sun) / functions["sqrt"](dot(to_sun, to_sun))
            lit = towards > 0.0 or dot(place, place) - towards**2 > EQUATORIAL_RADIUS**2
            sunlight = parameters["radiation"] * float(lit)
        return rho, sunlight

    return weather


def _motion(parameters: Mapping[str, float]) -> Callable[[Values, Functions], tuple[Any, ...]]:
    """Accelerations of the centre of mass and of the tether's unit vector."""
    field = field_at(parameters)
    zonal = {degree: parameters["oblateness"] * value for degree, value in ZONAL.items()}
    length, mass, reduced = (parameters[name] for name in ("L", "mass", "reduced"))
    # Parts that the air strikes: where they are above the centre of mass, over L, and their faces.
    middle = (parameters["m1"] + 0.5 * parameters["mt"]) / mass

    def motion(values: Values, functions: Functions) -> tuple[Any, ...]:
        place, speed = _triple(values, _PLACE), _triple(values, _SPEED)
        e, w, time = _triple(values, _TETHER), _triple(values, _TETHER_RATE), values["t"]
        days = parameters["epoch"] + time / _DAY
        square = dot(place, place)
        radius = functions["sqrt"](square)
        up = scaled(1.0 / radius, place)
        turn = cross(e, field(place, time, functions))
        pulls = [scaled(-GRAVITY / (square * radius), place), scaled(values["I"] * length / mass, turn)]
        if parameters["oblateness"]:
            pulls.append(zonal_acceleration(zonal, *place))
        to_sun = sun(days, functions)
        if parameters["third_body"]:
            share = parameters["third_body"]
            pulls.append(_third_body(share * _SUN_GRAVITY, to_sun, place, functions))
            pulls.append(_third_body(share * _MOON_GRAVITY, moon(days, functions), place, functions))
        wind = added(speed, (ROTATION_RATE * place[1], -ROTATION_RATE * place[0], 0.0))
        pressure = scaled(-0.5 * parameters["cd"] * values["rho"] * functions["sqrt"](dot(wind, wind)), wind)
        wire = length * parameters["d"] * _across(wind, e, functions)
        pulls.append(scaled((_UPPER_FACE + _LOWER_FACE + wire) / mass, pressure))
        lit = length * parameters["d"] * _across(to_sun, e, functions) + _UPPER_FACE + _LOWER_FACE
        shine = parameters["cr"] * _RADIATION_PRESSURE * values["sunlight"] * lit / mass
        pulls.append(scaled(-shine / functions["sqrt"](dot(to_sun, to_sun)), to_sun))
        lean = dot(up, e)
        arm = (1.0 - middle) * _UPPER_FACE - middle * _LOWER_FACE + (0.5 - middle) * wire
        turns = added(
            scaled(-dot(w, w), e),
            scaled(3.0 * GRAVITY / (square * radius) * lean, added(up, scaled(-lean, e))),
            scaled(parameters["offset"] * values["I"] / reduced, turn),
            scaled(arm / (reduced * length), added(pressure, scaled(-dot(pressure, e), e))),
        )
        return (*added(*pulls), *turns)

    return motion


def _third_body(gravity: float, body: Triple, place: Triple, functions: Functions) -> Triple:
    """The tidal acceleration by a body at ``body``."""
    way = added(body, scaled(-1.0, place))
    near, far = dot(way, way), dot(body, body)
    return added(
        scaled(gravity / (near * functions["sqrt"](near)), way),
        scaled(-gravity / (far * functions["sqrt"](far)), body),
    )


def _across(wind: Triple, e: Triple, functions: Functions) -> Any:
    """The sine of the angle between a direction and the tether."""
    along = dot(wind, e)
    return functions["sqrt"](functions["max"](1.0 - along * along / dot(wind, wind), 1e-12))


def _gravity(values: Values, square: Any) -> Any:
    """The parameter of gravity on the equator, with the oblateness of the Earth."""
    return GRAVITY * (1.0 + 1.5 * ZONAL[2] * values["oblateness"] * EQUATORIAL_RADIUS**2 / square)


def _observe(values: Values, functions: Functions) -> dict[str, Any]:
    place, speed = _triple(values, _PLACE), _triple(values, _SPEED)
    e, w = _triple(values, _TETHER), _triple(values, _TETHER_RATE)
    square, motion = dot(place, place), dot(place, speed)
    momentum = cross(place, speed)
    spin = functions["sqrt"](dot(momentum, momentum))
    # Along track and up, each times the radius.
    along = (square * dot(e, speed) - motion * dot(e, place)) / spin
    up = dot(e, place)
    along_rate = (
        motion * dot(e, speed) + square * dot(w, speed) - up * dot(speed, speed) - motion * dot(w, place)
    ) / spin
    up_rate = dot(w, place) + dot(e, speed)
    out = dot(e, momentum) / spin
    elements = elements_of(place, speed, _gravity(values, square), functions)
    return {
        "alpha": functions["atan2"](along, up),
        "alpha_dot": (along_rate * up - along * up_rate) / (along * along + up * up),
        "beta": -functions["asin"](out),
        "beta_dot": -dot(w, momentum) / spin / functions["sqrt"](1.0 - out * out),
        **dict(zip(("p", "f", "g", "h", "k", "lon"), elements, strict=True)),
    }


def _start(values: Values, functions: Functions) -> dict[str, Any]:
    axes = axes_of(values["h"], values["k"], values["lon"], functions)
    sl, cl = functions["sin"](values["lon"]), functions["cos"](values["lon"])
    eta = 1.0 + values["f"] * cl + values["g"] * sl
    radius = values["p"] / eta
    speed = functions["sqrt"](_gravity(values, radius * radius) / values["p"])
    turn = speed * eta / radius
    sa, ca = functions["sin"](values["alpha"]), functions["cos"](values["alpha"])
    sb, cb = functions["sin"](values["beta"]), functions["cos"](values["beta"])
    pitch, roll = values["alpha_dot"], values["beta_dot"]
    e = sa * cb, -sb, ca * cb
    w = (
        ca * cb * pitch - sa * sb * roll + turn * e[2],
        -cb * roll,
        -sa * cb * pitch - ca * sb * roll - turn * e[0],
    )
    vectors = (
        scaled(radius, axes.radial),
        axes.inertial((speed * eta, 0.0, speed * (values["f"] * sl - values["g"] * cl))),
        axes.inertial(e),
        axes.inertial(w),
    )
    return dict(zip(_STATES, sum(vectors, start=()), strict=True))


def _vector(names: tuple[str, ...], unit: str, meaning: str) -> dict[str, Quantity]:
    return {name: Quantity(unit, f"{meaning}, {name[-1]} component") for name in names}


MODEL = LibraryModel(
    name="edt_plant",
    title="Electrodynamic tether with all that moves it, in inertial axes: a plant to track on",
    source="Montenbruck, Gill, Satellite Orbits, Springer 2000, chapter 3; IGRF-14; NRLMSIS 2.1",
    states={
        **_vector(_PLACE, "m", "centre of mass"),
        **_vector(_SPEED, "m/s", "velocity of the centre of mass"),
        **_vector(_TETHER, "1", "unit vector from the sub-satellite to the main satellite"),
        **_vector(_TETHER_RATE, "1/s", "rate of the unit vector"),
    },
    controls={"I": Quantity("A", "current, positive upwards: it brakes")},
    parameters={
        **TETHER,
        "d": Parameter(5e-4, "m", "diameter of the tether", (0.0, 1.0)),
        "cd": Parameter(2.2, "1", "drag coefficient", (0.0, 10.0)),
        "cr": Parameter(1.3, "1", "radiation pressure coefficient", (0.0, 10.0)),
        **SURROUNDINGS,
        "third_body": Parameter(1.0, "1", "1 with the pull of Sun and Moon, 0 without", (0.0, 1.0)),
        "drag": Parameter(1.0, "1", "1 with the drag of the atmosphere, 0 without", (0.0, 1.0)),
        "radiation": Parameter(1.0, "1", "1 with the pressure of the sunlight, 0 without", (0.0, 1.0)),
        "F107": Parameter(150.0, "sfu", "solar flux at 10.7 cm, of the day and its mean", (50.0, 500.0)),
        "Ap": Parameter(4.0, "1", "planetary magnetic index", (0.0, 400.0)),
    },
    equations={
        "kind": "first_order",
        "states": list(_STATES),
        "controls": ["I"],
        "dynamics": dict(zip(_STATES, (*_SPEED, *_FORCED, *_TETHER_RATE, *_TURNED), strict=True)),
    },
    computed={
        **_vector(_FORCED, "m/s^2", "acceleration of the centre of mass"),
        **_vector(_TURNED, "1/s^2", "acceleration of the unit vector"),
        "rho": Quantity("kg/m^3", "density of the atmosphere"),
        "sunlight": Quantity("1", "1 in the sunlight, 0 in the shadow of the Earth"),
    },
    formulas=_formulas,
    views={"edt": View(_observe, _start, {"lon": 2.0 * pi})},
    plant_only=True,
)
