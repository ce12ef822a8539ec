"""One rigid mass moved by one force: the double integrator."""

from __future__ import annotations

from solvers.models.library_model import LibraryModel, Parameter, Quantity

MODEL = LibraryModel(
    name="rigid_body",
    title="Rigid body: one mass, one force",
    source="m x'' = u",
    states={
        "x": Quantity("m", "position"),
        "x_dot": Quantity("m/s", "velocity"),
    },
    controls={"u": Quantity("N", "force")},
    parameters={"m": Parameter(1.0, "kg", "mass")},
    equations={
        "kind": "mechanical",
        "coordinates": ["x"],
        "controls": ["u"],
        "mass": [["m"]],
        "input": [[1]],
    },
)
