"""The kinds of models: what the ``model`` object of a document may be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from solvers.models import LIBRARY
from solvers.spec.base import SpecModel
from solvers.spec.fields import Unsupported
from solvers.spec.matrices import ForceVector, MatrixOf
from solvers.spec.scope import MAX_CONTROLS, MAX_STATES, Scope, read_model
from solvers.spec.tables import DynamicsTable, LibraryName, NameList, OverrideTable, ParameterTable
from solvers.spec.values import Value, evaluate_constant

Row = tuple[Value, ...]
Controls = Annotated[tuple[str, ...], NameList("control", MAX_CONTROLS)]
Definitions = Annotated[None, Unsupported("definitions are")]


class _Equations(SpecModel):
    """What models with equations of their own have in common."""

    kind: str
    """The kind of model."""
    controls: Controls
    """Names of the controls."""
    parameters: Annotated[dict[str, Value], ParameterTable()] = Field(default_factory=dict)
    """Name -> value; a value may use parameters that stand before it."""
    definitions: Definitions = None
    """Named subexpressions; not in this version."""

    def parameter_values(self) -> dict[str, float]:
        """Return every parameter as a number, in the order of the document."""
        return parameter_values(self.parameters)


class MechanicalModel(_Equations):
    """M(q) q'' + C(q, q') q' + K q = G u + f(q, q', t) with n coordinates q and m controls u."""

    kind: Literal["mechanical"]
    """The kind of model."""
    coordinates: Annotated[tuple[str, ...], NameList("coordinate", MAX_STATES // 2, least=1)]
    """Names of the generalized coordinates q; each ``q`` brings its velocity ``q_dot`` as a state."""
    mass: Annotated[tuple[Row, ...], MatrixOf("coordinates")]
    """Mass matrix M, n x n, by rows."""
    damping: Annotated[tuple[Row, ...], MatrixOf("coordinates")] | None = None
    """Damping matrix C, n x n, by rows; it multiplies the velocities."""
    stiffness: Annotated[tuple[Row, ...], MatrixOf("coordinates")] | None = None
    """Stiffness matrix K, n x n, by rows; it multiplies the coordinates."""
    force: Annotated[Row, ForceVector()] | None = None
    """Force vector f on the right-hand side, length n."""
    input: Annotated[tuple[Row, ...], MatrixOf("controls")]
    """Input matrix G, n x m, by rows."""
    flexible: Annotated[None, Unsupported("vibration energy of flexible coordinates is")] = None
    """Names of the elastic coordinates; not in this version."""

    @property
    def states(self) -> tuple[str, ...]:
        """The coordinates, then their velocities in the same order."""
        return self.coordinates + tuple(f"{name}_dot" for name in self.coordinates)


class FirstOrderModel(_Equations):
    """x' = f(x, u, t), one expression for each state."""

    kind: Literal["first_order"]
    """The kind of model."""
    states: Annotated[tuple[str, ...], NameList("state", MAX_STATES, least=1)]
    """Names of the states x."""
    dynamics: Annotated[dict[str, Value], DynamicsTable()]
    """State -> its rate of change; one expression for every state."""


class LibraryReference(SpecModel):
    """A model that comes with the product."""

    kind: Literal["library"]
    """The kind of model."""
    name: Annotated[str, LibraryName()]
    """Name of the library model."""
    parameters: Annotated[dict[str, Value], OverrideTable()] = Field(default_factory=dict)
    """Values for parameters that shall differ from those of the library."""

    def expand(self) -> MechanicalModel | FirstOrderModel:
        """Return the model with its equations written out and every parameter given."""
        document = LIBRARY[self.name].document(self.parameters)
        scope = Scope({}, {}, document)
        read_model(scope)
        return _EQUATIONS.validate_python(document, context=scope)


SubmittedModel = MechanicalModel | FirstOrderModel | LibraryReference

_EQUATIONS: TypeAdapter[MechanicalModel | FirstOrderModel] = TypeAdapter(
    Annotated[MechanicalModel | FirstOrderModel, Field(discriminator="kind")]
)


def parameter_values(parameters: Mapping[str, Value]) -> dict[str, float]:
    """Return parameters as numbers; each may use those before it. Raises ExpressionError if one cannot be."""
    values: dict[str, float] = {}
    for name, value in parameters.items():
        values[name] = evaluate_constant(value, values)
    return values
