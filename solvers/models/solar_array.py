"""A spacecraft stretches a folded solar array of three panels: planar, free-floating, no angular momentum.

Body 1 carries the chain of panels 2, 3 and 4 on hinges; phi1 is its attitude, th1 to th3 are the hinge
angles, driven at the rates u. No force acts from outside and the total angular momentum is zero, so that
every motion of the panels turns the spacecraft. Absolute angles of the axes (body 1: centre of mass to
hinge; panels: inner to outer hinge):

    psi1 = phi1                            psi3 = phi1 - pi/2 - th1 + th2
    psi2 = phi1 + pi/2 - th1               psi4 = phi1 + pi/2 - th1 + th2 - th3

With the positions of the centres of mass r_i = sum_k C_ik e(psi_k) the angular momentum is
sum_k I_k psi_k' = 0, where I_k = J_k + sum_j G_kj cos(psi_k - psi_j) and G = C' (diag(m) - m m'/M) C. Angles
differ by hinge angles only: the rate of phi1 depends on th alone and is linear in u.

Source: Zhang, Ge, Liu, "A genetic algorithm for optimal control of stretching process of solar arrays on
spacecraft based on wavelet approximation" (1999), eq. (12); the equivalent inertias, which it does not give,
follow from the masses and lengths.
"""

from __future__ import annotations

from solvers.models.library_model import LibraryModel, Parameter, Quantity

_COSINES = {
    (1, 2): "sin(th1)",
    (1, 3): "sin(th2 - th1)",
    (1, 4): "sin(th1 - th2 + th3)",
    (2, 3): "-cos(th2)",
    (2, 4): "cos(th2 - th3)",
    (3, 4): "-cos(th3)",
}
"""cos(psi_k - psi_j) of each pair of bodies."""


def _definitions() -> dict[str, str]:
    """The cosines, the equivalent inertias I1 to I4, and their sums from each panel outwards."""
    cosines = {f"c{k}{j}": cosine for (k, j), cosine in _COSINES.items()}
    inertias = {
        f"I{body}": " + ".join(
            [f"J{body} + G{body}{body}", *(f"G{k}{j}*c{k}{j}" for k, j in _COSINES if body in (k, j))]
        )
        for body in (1, 2, 3, 4)
    }
    return {**cosines, **inertias, "I34": "I3 + I4", "I234": "I2 + I34"}


def _coupling(value: str, first: int, second: int) -> Parameter:
    description = f"inertia that couples bodies {first} and {second}; follows from masses and lengths"
    return Parameter(f"{value} - S{first}*S{second}/M", "kg m^2", description)


def _moment(value: str, body: int) -> Parameter:
    description = f"moment of mass along the axis of body {body}; follows from masses and lengths"
    return Parameter(value, "kg m", description)


def _own_inertia(body: int) -> Parameter:
    description = f"moment of inertia of panel {body} about its centre of mass"
    return Parameter(f"m{body}*L{body}^2/12", "kg m^2", description)


MODEL = LibraryModel(
    name="solar_array",
    title="Solar array: a spacecraft stretches three folded panels",
    source="Zhang, Ge and Liu (1999), eq. (12); equivalent inertias from the positions of the bodies",
    states={
        "phi1": Quantity("rad", "attitude of the spacecraft"),
        "th1": Quantity("rad", "hinge angle between spacecraft and panel 2"),
        "th2": Quantity("rad", "hinge angle between panels 2 and 3"),
        "th3": Quantity("rad", "hinge angle between panels 3 and 4"),
    },
    controls={
        "u1": Quantity("rad/s", "rate of th1"),
        "u2": Quantity("rad/s", "rate of th2"),
        "u3": Quantity("rad/s", "rate of th3"),
    },
    parameters={
        "m1": Parameter(200.0, "kg", "mass of the spacecraft"),
        "m2": Parameter(5.0, "kg", "mass of panel 2"),
        "m3": Parameter(10.0, "kg", "mass of panel 3"),
        "m4": Parameter(10.0, "kg", "mass of panel 4"),
        "l1": Parameter(0.5, "m", "distance from the spacecraft's centre of mass to its hinge"),
        "L2": Parameter(0.5, "m", "length of panel 2 along the chain"),
        "L3": Parameter(1.0, "m", "length of panel 3 along the chain"),
        "L4": Parameter(1.0, "m", "length of panel 4 along the chain"),
        "J1": Parameter(32.2, "kg m^2", "moment of inertia of the spacecraft about its centre of mass"),
        "J2": _own_inertia(2),
        "J3": _own_inertia(3),
        "J4": _own_inertia(4),
        "M": Parameter("m1 + m2 + m3 + m4", "kg", "mass of all bodies; follows from theirs"),
        "S1": _moment("l1*(m2 + m3 + m4)", 1),
        "S2": _moment("L2*(m2/2 + m3 + m4)", 2),
        "S3": _moment("L3*(m3/2 + m4)", 3),
        "S4": _moment("L4*m4/2", 4),
        "G11": _coupling("l1^2*(m2 + m3 + m4)", 1, 1),
        "G12": _coupling("l1*S2", 1, 2),
        "G13": _coupling("l1*S3", 1, 3),
        "G14": _coupling("l1*S4", 1, 4),
        "G22": _coupling("L2^2*(m2/4 + m3 + m4)", 2, 2),
        "G23": _coupling("L2*S3", 2, 3),
        "G24": _coupling("L2*S4", 2, 4),
        "G33": _coupling("L3^2*(m3/4 + m4)", 3, 3),
        "G34": _coupling("L3*S4", 3, 4),
        "G44": _coupling("L4^2*m4/4", 4, 4),
    },
    equations={
        "kind": "first_order",
        "states": ["phi1", "th1", "th2", "th3"],
        "controls": ["u1", "u2", "u3"],
        "definitions": _definitions(),
        "dynamics": {"phi1": "(I234*u1 - I34*u2 + I4*u3)/(I1 + I234)", "th1": "u1", "th2": "u2", "th3": "u3"},
    },
)
