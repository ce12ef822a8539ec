"""A rigid hub with two symmetric flexible appendages, each a tip mass on a massless arm with a root spring.

The hub (inertia Jb, radius R) turns by theta; the arms (length L, tip mass m, root stiffness k) bend
antisymmetrically by alpha relative to the hub. Kinetic energy of the two tips and the hub, elastic energy of
the two springs; Lagrange's equations give mass, damping (Coriolis and centrifugal) and stiffness matrices.
"""

from __future__ import annotations

from solvers.models.library_model import LibraryModel, Parameter, Quantity

_COUPLING = "2*m*(L^2 + R*L*cos(alpha))"

MODEL = LibraryModel(
    name="flexible_spacecraft",
    title="Flexible spacecraft: a hub with two flexible appendages",
    source="Lagrange's equations of a hub with two tip masses on sprung arms",
    states={
        "theta": Quantity("rad", "attitude of the hub"),
        "alpha": Quantity("rad", "deflection of the appendages relative to the hub"),
        "theta_dot": Quantity("rad/s", "angular velocity of the hub"),
        "alpha_dot": Quantity("rad/s", "rate of deflection"),
    },
    controls={"T": Quantity("N m", "torque on the hub")},
    parameters={
        "Jb": Parameter(440.0, "kg m^2", "moment of inertia of the hub"),
        "R": Parameter(2.5, "m", "radius of the hub: where an appendage is fixed"),
        "m": Parameter(10.0, "kg", "tip mass of each appendage"),
        "L": Parameter(5.0, "m", "length of each appendage"),
        "k": Parameter(100.0, "N m/rad", "stiffness at the root of each appendage"),
    },
    equations={
        "kind": "mechanical",
        "coordinates": ["theta", "alpha"],
        "controls": ["T"],
        "mass": [["Jb + 2*m*(R^2 + L^2 + 2*R*L*cos(alpha))", _COUPLING], [_COUPLING, "2*m*L^2"]],
        "damping": [
            ["-2*m*R*L*sin(alpha)*alpha_dot", "-2*m*R*L*sin(alpha)*(theta_dot + alpha_dot)"],
            ["2*m*R*L*sin(alpha)*theta_dot", 0],
        ],
        "stiffness": [[0, 0], [0, "2*k"]],
        "input": [[1], [0]],
        "flexible": ["alpha"],
    },
)
