"""A partial space elevator: a climber between a main satellite and an end body, on two tethers in the plane.

The main satellite is heavy, on a circular orbit; the climber (m1) hangs on tether 1 (L1, th1), the end body
(m2) on tether 2 (L2 = L0 + Lc - L1, th2) below it; Lc is how much tether the end body has paid out. Angles
count from the local vertical, positive with the orbital motion; tethers have no mass and do not stretch.
With d = th2 - th1 and the orbital rate om:

    th1'' = -2 L1'/L1 (th1' + om) + s1 + T2 sin d/(m1 L1)
    th2'' = -2 L2'/L2 (th2' + om) + s2 - T1 sin d/(m1 L2)
    L1''  = L1 [(th1' + om)^2 - om^2] + c1 + (T2 cos d - T1)/m1
    L2''  = L2 [(th2' + om)^2 - om^2] + c2 + T1 cos d/m1 - T2 (1/m1 + 1/m2),      Lc'' = L1'' + L2''

and what gravity and the orbit's rotation leave over, across and along each tether:

    ``pse``              s = -3/2 om^2 sin 2 th, c = 3 om^2 L cos^2 th (gravity linear in the distance)
    ``pse_exact``        the difference of exact inverse-square gravity at both ends of the tether
    ``pse_small_angle``  s = -3 om^2 th, c = 3 om^2 L, sin d = d, cos d = 1

Source: Zhu, Shi, "Piecewise Parallel Optimal Algorithm", IntechOpen 2018, doi 10.5772/intechopen.76625 (whose
equations are lost; derived anew, see docs/methods/piecewise.md).
"""

from __future__ import annotations

from solvers.models.library_model import LibraryModel, Parameter, Quantity
from solvers.space.earth import GRAVITY

_POSITIVE = (1e-12, 1e12)
_STATES = {
    "th1": Quantity("rad", "angle of tether 1 from the local vertical"),
    "th1_dot": Quantity("rad/s", "its rate"),
    "th2": Quantity("rad", "angle of tether 2 from the local vertical"),
    "th2_dot": Quantity("rad/s", "its rate"),
    "L1": Quantity("m", "length of tether 1: from the main satellite to the climber"),
    "L1_dot": Quantity("m/s", "its rate: the climber ascends where it is negative"),
    "Lc": Quantity("m", "tether paid out at the end body"),
    "Lc_dot": Quantity("m/s", "its rate"),
}
_PARAMETERS = {
    "m1": Parameter(500.0, "kg", "mass of the climber", _POSITIVE),
    "m2": Parameter(1000.0, "kg", "mass of the end body", _POSITIVE),
    "L0": Parameter(20_000.0, "m", "length of both tethers before any is paid out", _POSITIVE),
    "r": Parameter(7.1e6, "m", "radius of the main satellite's orbit", _POSITIVE),
    "om": Parameter(f"sqrt({GRAVITY!r}/r^3)", "rad/s", "orbital rate; follows from the radius"),
    "L1_end": Parameter(500.0, "m", "length of tether 1 at the end of the transfer"),
    "T_max": Parameter(200.0, "N", "largest tension"),
    "th_max": Parameter(0.3, "rad", "largest angle"),
    "slowest": Parameter(15.0, "m/s", "slowest ascent"),
    "fastest": Parameter(25.0, "m/s", "fastest ascent"),
    "Lc_max": Parameter(5_000.0, "m", "longest way of the end body"),
    "Lc_fastest": Parameter(10.0, "m/s", "fastest paying out and hauling in"),
}
_EXACT = {
    # From the Earth's centre, main satellite at r along the vertical: climber, then end body.
    "y1": "r - L1*cos(th1)",
    "x1": "-L1*sin(th1)",
    "y2": "y1 - L2*cos(th2)",
    "x2": "x1 - L2*sin(th2)",
    "pull1": f"{GRAVITY!r}/(x1^2 + y1^2)^1.5",
    "pull2": f"{GRAVITY!r}/(x2^2 + y2^2)^1.5",
    # What gravity less the orbit's own leaves over of each relative acceleration, forward and up.
    "gx1": "-pull1*x1",
    "gy1": "om^2*r - pull1*y1",
    "gx2": "pull1*x1 - pull2*x2",
    "gy2": "pull1*y1 - pull2*y2",
}


def _model(
    name: str, title: str, definitions: dict[str, str], gravity: tuple[str, ...], angles: bool
) -> LibraryModel:
    """A form of the model: ``gravity`` is L1 s1, L2 s2, c1 and c2; ``angles``: sin and cos of d."""
    sine, cosine = ("sin(th2 - th1)", "cos(th2 - th1)") if angles else ("(th2 - th1)", "1")
    s1, s2, c1, c2 = gravity
    dynamics = {
        "th1": "th1_dot",
        "th1_dot": f"-2*L1_dot/L1*(th1_dot + om) + ({s1})/L1 + T2*{sine}/(m1*L1)",
        "th2": "th2_dot",
        "th2_dot": f"-2*L2_dot/L2*(th2_dot + om) + ({s2})/L2 - T1*{sine}/(m1*L2)",
        "L1": "L1_dot",
        "L1_dot": "stretch1",
        "Lc": "Lc_dot",
        "Lc_dot": "stretch1 + stretch2",
    }
    return LibraryModel(
        name=name,
        title=title,
        source="Zhu, Shi, Piecewise Parallel Optimal Algorithm, 2018, doi 10.5772/intechopen.76625",
        states=_STATES,
        controls={
            "T1": Quantity("N", "tension of tether 1"),
            "T2": Quantity("N", "tension of tether 2"),
        },
        parameters=_PARAMETERS,
        equations={
            "kind": "first_order",
            "states": list(dynamics),
            "controls": ["T1", "T2"],
            "definitions": {
                "L2": "L0 + Lc - L1",
                "L2_dot": "Lc_dot - L1_dot",
                **definitions,
                "stretch1": f"L1*((th1_dot + om)^2 - om^2) + {c1} + (T2*{cosine} - T1)/m1",
                "stretch2": (f"L2*((th2_dot + om)^2 - om^2) + {c2} + T1*{cosine}/m1 - T2*(1/m1 + 1/m2)"),
            },
            "dynamics": dynamics,
        },
    )


HILL = _model(
    "pse",
    "Partial space elevator, gravity linear in the distance (Hill)",
    {},
    (
        "-1.5*om^2*L1*sin(2*th1)",
        "-1.5*om^2*L2*sin(2*th2)",
        "3*om^2*L1*cos(th1)^2",
        "3*om^2*L2*cos(th2)^2",
    ),
    angles=True,
)
EXACT = _model(
    "pse_exact",
    "Partial space elevator, exact gravity",
    _EXACT,
    (
        "-gx1*cos(th1) + gy1*sin(th1)",
        "-gx2*cos(th2) + gy2*sin(th2)",
        "om^2*L1 - gx1*sin(th1) - gy1*cos(th1)",
        "om^2*L2 - gx2*sin(th2) - gy2*cos(th2)",
    ),
    angles=True,
)
SMALL_ANGLE = _model(
    "pse_small_angle",
    "Partial space elevator, small angles",
    {},
    ("-3*om^2*L1*th1", "-3*om^2*L2*th2", "3*om^2*L1", "3*om^2*L2"),
    angles=False,
)
