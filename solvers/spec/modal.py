"""Rigid axes with structural modes, as flexible-spacecraft people hold them, and the matrices they stand for.

``constrained`` modes (hub held fast), eta'' + 2 zeta w eta' + w^2 eta + delta' theta'' = 0 with the couplings
delta, and J theta'' + delta eta'' = G u: J - delta delta' must be positive definite, for it is the inertia of
what the modes leave at rest.

``free`` modes (hub and appendages floating) shape the attitude, theta = theta_r + phi eta with the rotations
phi of the axes for a unit of each mode: J theta_r'' = G u, eta'' + 2 zeta w eta' + w^2 eta = phi' G u. In
theta and eta the mass matrix is [[J, -J phi], [-phi' J, 1 + phi' J phi]].

Source: Likins, "Dynamics and control of flexible space vehicles", JPL TR 32-1329, 1970; Hughes, "Modal
identities for elastic bodies", J. Applied Mechanics 47, 1980.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import field_validator

from solvers.spec.base import SpecModel
from solvers.spec.faults import refuse
from solvers.spec.fields import ExpressionIn, Text, at_most
from solvers.spec.matrices import Matrix, MatrixOf, matrix_rows
from solvers.spec.scope import MAX_STATES
from solvers.spec.tables import AxisValues, NameList
from solvers.spec.values import Value

OfParameters = Annotated[Value, ExpressionIn("parameter")]


class Mode(SpecModel):
    """A structural mode of unit modal mass."""

    name: Annotated[str, Text()]
    """Name of its modal coordinate, a state as ``<name>_dot`` is."""
    frequency_hz: OfParameters
    """Natural frequency, Hz: of the structure as ``mode_basis`` says."""
    damping: OfParameters = 0
    """Ratio to the critical damping."""
    coupling: Annotated[list[Value], AxisValues()]
    """For each axis its coupling, sqrt(kg) m; in a free basis its rotation for a unit of the mode."""


class ModalEquations(SpecModel):
    """The keys of a modal model beside those that all models have."""

    axes: Annotated[tuple[str, ...], NameList("axis", 3, least=1)]
    """Names of the rigid rotations; each brings its velocity ``<axis>_dot`` as a state."""
    inertia: Annotated[Matrix, MatrixOf("axes", rows="axes", place="parameter")]
    """Inertia J of the whole about the axes, kg m^2."""
    input: Annotated[Matrix, MatrixOf("controls", rows="axes", place="parameter")]
    """Input matrix G: the torque about each axis for each control."""
    modes: Annotated[list[Mode], at_most(MAX_STATES // 2 - 1, "modes")]
    """Structural modes."""
    mode_basis: Literal["constrained", "free"]
    """Of what the modes are: the structure with its hub held fast, or the floating whole."""

    @field_validator("mode_basis", mode="before")
    @classmethod
    def _basis(cls, value: Any) -> Any:
        if value not in ("constrained", "free"):
            raise refuse("must be 'constrained' or 'free'")
        return value

    def matrices(self, controls: int) -> dict[str, Any]:
        """The matrices of the mechanical model that this stands for, for a number of controls."""
        axes, modes = len(self.axes), len(self.modes)
        inertia = matrix_rows(self.inertia, axes, axes)
        couplings = [mode.coupling for mode in self.modes]
        mixed: list[list[Value]]
        inner: list[list[Value]]
        if self.mode_basis == "free":
            mixed = [[_negative(_sum_of_products(row, shape)) for shape in couplings] for row in inertia]
            inner = [
                [
                    _sum_of_products(shape, [_negative(entry) for entry in column], float(k == other))
                    for other, column in enumerate(zip(*mixed, strict=True))
                ]
                for k, shape in enumerate(couplings)
            ]
        else:
            mixed = [[coupling[axis] for coupling in couplings] for axis in range(axes)]
            inner = [[float(k == other) for other in range(modes)] for k in range(modes)]
        return {
            "mass": [
                *([*row, *beside] for row, beside in zip(inertia, mixed, strict=True)),
                *([mixed[axis][k] for axis in range(axes)] + inner[k] for k in range(modes)),
            ],
            "damping": {"diag": [0] * axes + [_damping(mode) for mode in self.modes]},
            "stiffness": {"diag": [0] * axes + [f"(2*pi*({mode.frequency_hz}))^2" for mode in self.modes]},
            "input": [
                *map(list, matrix_rows(self.input, axes, controls)),
                *([0] * controls for _ in couplings),
            ],
        }


def _damping(mode: Mode) -> str:
    return f"2*({mode.damping})*(2*pi*({mode.frequency_hz}))"


def _negative(value: Value) -> str:
    return f"-({value})"


def _sum_of_products(left: Sequence[Value], right: Sequence[Value], start: float = 0.0) -> str:
    return " + ".join([repr(start), *(f"({a})*({b})" for a, b in zip(left, right, strict=True))])
