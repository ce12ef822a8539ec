"""The kinds of models: what the ``model`` object of a document may be."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from solvers.expressions import parse
from solvers.models import LIBRARY, Formula, LibraryModel
from solvers.spec.base import SpecModel
from solvers.spec.faults import Path
from solvers.spec.matrices import ForceVector, Matrix, MatrixOf, Row, matrix_rows, places
from solvers.spec.modal import ModalEquations
from solvers.spec.scope import MAX_CONTROLS, MAX_STATES, Scope, read_model
from solvers.spec.tables import (
    DefinitionTable,
    DynamicsTable,
    FlexibleNames,
    LibraryName,
    NameList,
    OptionTable,
    OverrideTable,
    ParameterTable,
)
from solvers.spec.values import Value, evaluate_constant

Controls = Annotated[tuple[str, ...], NameList("control", MAX_CONTROLS)]

MATRICES = ("mass", "damping", "stiffness", "input")


class _Equations(SpecModel):
    """What models with equations of their own have in common."""

    kind: str
    """The kind of model."""
    controls: Controls
    """Names of the controls."""
    parameters: Annotated[dict[str, Value], ParameterTable()] = Field(default_factory=dict)
    """Name -> value; a value may use parameters that stand before it."""
    definitions: Annotated[dict[str, Value], DefinitionTable()] = Field(default_factory=dict)
    """Name -> expression; each may use those that stand before it, and is evaluated once."""

    def depending_on(self, names: Collection[str]) -> list[str]:
        """Return the parameters that follow from those of these names, in order, without these themselves."""
        found: set[str] = set()
        for name, value in self.parameters.items():
            if name not in names and parse(value).names & (found | set(names)):
                found.add(name)
        return [name for name in self.parameters if name in found]

    def parameter_values(self) -> dict[str, float]:
        """Return every parameter as a number, in the order of the document."""
        return parameter_values(self.parameters)


class MechanicalModel(_Equations):
    """M(q) q'' + C(q, q') q' + K q = G u + f(q, q', t) with n coordinates q and m controls u."""

    kind: Literal["mechanical"]
    """The kind of model."""
    coordinates: Annotated[tuple[str, ...], NameList("coordinate", MAX_STATES // 2, least=1)]
    """Names of the generalized coordinates q; each ``q`` brings its velocity ``q_dot`` as a state."""
    mass: Annotated[Matrix, MatrixOf("coordinates")]
    """Mass matrix M, n x n: rows, ``{"diag": [...]}`` or ``{"entries": [[i, j, value]]}``."""
    damping: Annotated[Matrix, MatrixOf("coordinates")] | None = None
    """Damping matrix C, n x n, likewise; it multiplies the velocities."""
    stiffness: Annotated[Matrix, MatrixOf("coordinates")] | None = None
    """Stiffness matrix K, n x n, likewise; it multiplies the coordinates."""
    force: Annotated[Row, ForceVector()] | None = None
    """Force vector f on the right-hand side, length n."""
    input: Annotated[Matrix, MatrixOf("controls")]
    """Input matrix G, n x m, likewise."""
    flexible: Annotated[tuple[str, ...], FlexibleNames("coordinate", MAX_STATES // 2)] = ()
    """Names of the elastic coordinates; they bring the output ``vibration_energy``."""

    @property
    def states(self) -> tuple[str, ...]:
        """The coordinates, then their velocities in the same order."""
        return self.coordinates + tuple(f"{name}_dot" for name in self.coordinates)

    def rows(self, key: str) -> tuple[Row, ...] | None:
        """Return all rows of one of `MATRICES`, None where there is none."""
        matrix = getattr(self, key)
        width = len(self.controls if key == "input" else self.coordinates)
        return None if matrix is None else matrix_rows(matrix, len(self.coordinates), width)

    def entries(self) -> Iterator[tuple[Path, Value]]:
        """Yield every expression of matrices and force with its place in the model object."""
        for key in MATRICES:
            for place, _, _, entry in places(getattr(self, key) or ()):
                yield (key, *place), entry
        for index, entry in enumerate(self.force or ()):
            yield ("force", index), entry


class ModalModel(_Equations, ModalEquations):
    """Rigid axes and structural modes: J theta'' + delta eta'' = G u, with unit modal masses."""

    kind: Literal["modal"]
    """The kind of model."""

    def expand(self) -> MechanicalModel:
        """Return the mechanical model with coordinates (axes, modes)."""
        modes = [mode.name for mode in self.modes]
        document = {
            "kind": "mechanical",
            "coordinates": [*self.axes, *modes],
            "controls": list(self.controls),
            "parameters": self.parameters,
            "definitions": self.definitions,
            "flexible": modes,
            **self.matrices(len(self.controls)),
        }
        # The data tables that it calls are those of its document, which has been checked.
        tables = frozenset().union(*(parse(value).called for value in self.definitions.values()))
        scope = Scope({}, {}, document, table_names=tables)
        read_model(scope)
        return MechanicalModel.model_validate(document, context=scope)


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
    options: Annotated[dict[str, int | str], OptionTable()] = Field(default_factory=dict)
    """Choices of structure, where the model has any."""

    @property
    def entry(self) -> LibraryModel:
        """The model of the library with these options."""
        return LIBRARY[self.name].with_options(self.options)

    def expand(self) -> MechanicalModel | FirstOrderModel:
        """Return the model with its equations written out and every parameter given."""
        reference = {"kind": "library", "name": self.name, "parameters": self.parameters}
        scope = Scope({}, {}, {**reference, "options": self.options})
        read_model(scope)
        return _EQUATIONS.validate_python(scope.model, context=scope)


SubmittedModel = MechanicalModel | ModalModel | FirstOrderModel | LibraryReference

_EQUATIONS: TypeAdapter[MechanicalModel | FirstOrderModel] = TypeAdapter(
    Annotated[MechanicalModel | FirstOrderModel, Field(discriminator="kind")]
)


def written_out(submitted: SubmittedModel) -> MechanicalModel | FirstOrderModel:
    """Return a model by its equations: those of a library or modal model written out."""
    return submitted.expand() if isinstance(submitted, LibraryReference | ModalModel) else submitted


def definitions_of(submitted: SubmittedModel, model: MechanicalModel | FirstOrderModel) -> dict[str, Formula]:
    """Return what a model defines by name: what the library computes for it, then its own definitions."""
    known: dict[str, Formula] = {}
    if isinstance(submitted, LibraryReference):
        for computed in LIBRARY[submitted.name].formulas(model.parameter_values()):
            known |= computed.definitions
    return known | {name: parse(value) for name, value in model.definitions.items()}


def parameter_values(parameters: Mapping[str, Value]) -> dict[str, float]:
    """Return parameters as numbers; each may use those before it. Raises ExpressionError if one cannot be."""
    values: dict[str, float] = {}
    for name, value in parameters.items():
        values[name] = evaluate_constant(value, values)
    return values
