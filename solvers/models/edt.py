"""An electrodynamic tether as a rigid dumbbell on an orbit whose elements stay: the model for predictions.

The tether's unit vector from the sub-satellite to the main satellite is, along track, normal and radial,
e = (sin a cos b, -sin b, cos a cos b) with pitch a and roll b. With I > 0 along e the force I L e x B brakes.
With n = nu' and B along the orbital axes:

    a'' = -n' + 2 (a' + n) b' tan b - 3 mu/r^3 sin a cos a
          - offset I/reduced [By + tan b (Bx sin a + Bz cos a)]
    b'' = -(a' + n)^2 sin b cos b - 3 mu/r^3 cos^2 a sin b cos b + offset I/reduced [Bz sin a - Bx cos a]

Only the true longitude moves along the orbit; gravity there is stronger by the oblateness of the Earth, so
that a circle on which its plant flies is one here.

Source: Zhu, Shi, "Piecewise Parallel Optimal Algorithm", IntechOpen 2018, doi 10.5772/intechopen.76625 (whose
equations are lost; derived anew, see docs/methods/piecewise.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from solvers.models.computed import Computed
from solvers.models.library_model import LibraryModel, Quantity
from solvers.models.tether import SURROUNDINGS, TETHER, field_at
from solvers.space.earth import EQUATORIAL_RADIUS, GRAVITY, ZONAL
from solvers.space.equinoctial import axes_of
from solvers.space.vectors import scaled

Functions = Mapping[str, Callable[..., Any]]

_ORBIT = ("p", "f", "g", "h", "k", "lon")
_DEFINITIONS = {
    "eta": "1 + f*cos(lon) + g*sin(lon)",
    "e_sin": "f*sin(lon) - g*cos(lon)",
    "gravity": f"{GRAVITY!r}*(1 + {1.5 * ZONAL[2]!r}*oblateness*({EQUATORIAL_RADIUS!r}*eta/p)^2)",
    "turn": "sqrt(gravity/p^3)*eta^2",
    "turn_rate": "-2*e_sin*turn^2/eta",
    "gradient": f"3*{GRAVITY!r}*(eta/p)^3",
    "torque": "offset*I/reduced",
    "power": (
        "I*L*sqrt(gravity/p)*(e_sin*(sin(alpha)*cos(beta)*By + sin(beta)*Bx)"
        " - eta*(sin(beta)*Bz + cos(alpha)*cos(beta)*By))"
    ),
}
_DYNAMICS = {
    "alpha": "alpha_dot",
    "alpha_dot": (
        "-turn_rate + 2*(alpha_dot + turn)*beta_dot*tan(beta) - gradient*sin(alpha)*cos(alpha)"
        " - torque*(By + tan(beta)*(Bx*sin(alpha) + Bz*cos(alpha)))"
    ),
    "beta": "beta_dot",
    "beta_dot": (
        "-(alpha_dot + turn)^2*sin(beta)*cos(beta) - gradient*cos(alpha)^2*sin(beta)*cos(beta)"
        " + torque*(Bz*sin(alpha) - Bx*cos(alpha))"
    ),
    **dict.fromkeys(_ORBIT, 0),
    "lon": "turn",
}


def _formulas(parameters: Mapping[str, float]) -> list[Computed]:
    field = field_at(parameters)

    def along_the_axes(values: Mapping[str, Any], functions: Functions) -> tuple[Any, ...]:
        axes = axes_of(values["h"], values["k"], values["lon"], functions)
        eta = (
            1.0
            + values["f"] * functions["cos"](values["lon"])
            + values["g"] * functions["sin"](values["lon"])
        )
        place = scaled(values["p"] / eta, axes.radial)
        return axes.components(field(place, values["t"], functions))

    numbers = {name: parameters[name] for name in SURROUNDINGS}
    return [Computed(("Bx", "By", "Bz"), frozenset({*_ORBIT, "t"}), along_the_axes, f"edt {numbers}")]


MODEL = LibraryModel(
    name="edt",
    title="Electrodynamic tether on a fixed orbit: pitch and roll of a rigid dumbbell",
    source='Zhu, Shi, "Piecewise Parallel Optimal Algorithm", IntechOpen 2018, doi 10.5772/intechopen.76625',
    states={
        "alpha": Quantity("rad", "pitch: from the local vertical forward, in the plane of the orbit"),
        "alpha_dot": Quantity("rad/s", "rate of pitch"),
        "beta": Quantity("rad", "roll: out of the plane of the orbit"),
        "beta_dot": Quantity("rad/s", "rate of roll"),
        "p": Quantity("m", "semi-latus rectum of the orbit"),
        "f": Quantity("1", "eccentricity times the cosine of the longitude of perigee"),
        "g": Quantity("1", "eccentricity times the sine of the longitude of perigee"),
        "h": Quantity("1", "tangent of half the inclination times the cosine of the node"),
        "k": Quantity("1", "tangent of half the inclination times the sine of the node"),
        "lon": Quantity("rad", "true longitude"),
    },
    controls={"I": Quantity("A", "current, positive upwards: it brakes")},
    parameters={**TETHER, **SURROUNDINGS},
    equations={
        "kind": "first_order",
        "states": list(_DYNAMICS),
        "controls": ["I"],
        "definitions": _DEFINITIONS,
        "dynamics": _DYNAMICS,
    },
    computed={
        "Bx": Quantity("T", "magnetic field along track"),
        "By": Quantity("T", "magnetic field along the orbit normal"),
        "Bz": Quantity("T", "magnetic field upwards"),
    },
    formulas=_formulas,
)
