"""The parts of the ``piecewise`` method: segments, when to stop, tracking, plant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

from pydantic import Field

from solvers.expressions import quoted
from solvers.models import LIBRARY
from solvers.spec.base import SpecModel
from solvers.spec.checks import check_bound, check_constant, check_expression, is_number
from solvers.spec.faults import Flaws, kind_of, refuse
from solvers.spec.fields import (
    BOUND_SCHEMA,
    VALUE_SCHEMA,
    Bound,
    BoundaryExpression,
    Check,
    Count,
    Flag,
    Real,
    ShapedCheck,
    Text,
)
from solvers.spec.models import LibraryReference, SubmittedModel
from solvers.spec.scope import Scope, mapping, read_model
from solvers.spec.tables import object_of, unknown_key
from solvers.spec.values import BoundValue, Value

MAX_SEGMENTS = 10_000
MAX_SEGMENT_NODES = 200


@dataclass(frozen=True)
class QuantityTable(Check):
    """Name -> positive value (or bound) of states, of controls, or of both."""

    what: Literal["state", "control"]
    bounds: bool = False

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        table, flaws = object_of(value), Flaws()
        names = scope.states if self.what == "state" else scope.controls
        for name, item in table.items():
            if scope.known and name not in names:
                flaws.add(unknown_key(name, self.what, names, scope), name)
            elif self.bounds:
                check_bound(item, scope, flaws, name)
            else:
                number = check_constant(item, scope, flaws, name)
                if number is not None and number <= 0:
                    flaws.add(f"must be greater than 0, not {number:g}", name)
        flaws.raise_any()
        return table

    def schema(self) -> dict[str, Any]:
        """An object of values."""
        return {"type": "object", "additionalProperties": BOUND_SCHEMA if self.bounds else VALUE_SCHEMA}


@dataclass(frozen=True)
class CountOrEnd(Check):
    """A whole number of things, or ``"end"``."""

    count: Count

    def check(self, value: Any, scope: Scope) -> int | str:
        """Return the number or the word."""
        if value == "end":
            return "end"
        if not is_number(value) and not isinstance(value, str):
            raise refuse(f"must be a whole number or 'end', not {kind_of(value)}")
        if isinstance(value, str) and value.isidentifier() and value not in scope.parameter_names:
            raise refuse(f"must be a whole number or 'end', not {quoted(value)}")
        return self.count.check(value, scope)

    def schema(self) -> dict[str, Any]:
        """A number or a word."""
        return {"anyOf": [self.count.schema(), {"const": "end"}]}


class Segments(SpecModel):
    """How the way is cut into segments: by equal lengths of time, or of a state."""

    by: Annotated[str, Text(200)]
    """``time``, or the name of the state that goes from its initial to its final value."""
    length: Annotated[float, Real(above=0)] | None = None
    """Length of a segment in time; only by time."""
    count: Annotated[int, Count(1, MAX_SEGMENTS, "segments")] | None = None
    """Number of segments; only by a state."""


class Stop(SpecModel):
    """What ends the mission: a boundary constraint that is met on the way."""

    name: Annotated[str, Text(200)] = ""
    """A name for the result."""
    expression: BoundaryExpression
    """Expression as in boundary constraints, the tracked flight so far being the whole."""
    bounds: Bound
    """Where its value ends the mission."""
    average: Annotated[bool | None, Flag()] = None
    """Whether the end is a mean over a segment, taken at its middle, instead of an instant."""


class Tracking(SpecModel):
    """How the reference is tracked: the quadratic problem solved backwards from the end of its horizon."""

    Q: Annotated[dict[str, Value], QuantityTable("state")] = Field(default_factory=dict)
    """State -> deviation that weighs 1; without any, every state by a hundredth of its scale."""
    R: Annotated[dict[str, Value], QuantityTable("control")] = Field(default_factory=dict)
    """Control -> deviation that weighs 1; by default a quarter of the range of its limits."""
    S: Annotated[dict[str, Value], QuantityTable("state")] = Field(default_factory=dict)
    """State -> deviation at the end that weighs 1; by default the weights of Q times 10."""
    horizon: Annotated[int | Literal["end"], CountOrEnd(Count(1, MAX_SEGMENT_NODES, "nodes"))] = "end"
    """Number of nodes that each gain looks ahead, or to the ``end`` of the segment."""
    limits: Annotated[dict[str, BoundValue], QuantityTable("control", bounds=True)] = Field(
        default_factory=dict
    )
    """Control -> limits of the actuator, at which it is clipped; by default the bounds of the problem."""


class ExpressionMap(Check):
    """Name -> expression; the names on both sides are judged together with the plant's model."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        return object_of(value)

    def schema(self) -> dict[str, Any]:
        """An object of expressions."""
        return {"type": "object", "additionalProperties": VALUE_SCHEMA}


class Plant(SpecModel):
    """What is flown: a model, how it is seen as the simple one, and how it is started from it."""

    model: SubmittedModel = Field(discriminator="kind")
    """The equations of motion of the plant."""
    observe: Annotated[dict[str, Value], ExpressionMap()] = Field(default_factory=dict)
    """State of the simple model -> expression in states and parameters of the plant, and t."""
    start: Annotated[dict[str, Value], ExpressionMap()] = Field(default_factory=dict)
    """State of the plant -> expression in states of the simple model, parameters of both, and t."""

    def sees(self, simple: str | None) -> bool:
        """Tell whether the library says how this plant is seen as the ``simple`` library model."""
        model = self.model
        return isinstance(model, LibraryReference) and simple in LIBRARY[model.name].views


class PlantCheck(ShapedCheck):
    """A plant, checked in the names of its own model; the keys of its model may stand beside the others."""

    def check(self, value: Any, scope: Scope) -> Plant | None:
        """Return the plant."""
        if value is None:
            return None
        from solvers.spec.translate import nested  # which knows every object of a document, this one too

        given = object_of(value)
        flat = "model" not in given and "kind" in given
        if flat:
            maps: dict[str, Any] = {key: given[key] for key in ("observe", "start") if key in given}
            given = {"model": {key: item for key, item in given.items() if key not in maps}, **maps}
        own = Scope(scope.document, {}, mapping(given.get("model")), suggestions=scope.suggestions)
        read_model(own)
        flaws = Flaws()
        plant = nested(Plant, given, own, flaws)
        if scope.known and own.known:
            _check_controls(scope, own, flaws)
            simple = mapping(scope.problem.get("model"))
            name = simple.get("name") if simple.get("kind") == "library" else None
            view = plant is not None and plant.sees(name)
            seen = own.parameter_names.union(own.states, ("t",))
            observing = replace(own, model_names=seen)
            _check_map(given, "observe", scope.states, own.states, observing, view, flaws)
            begun = own.parameter_names.union(scope.parameter_names, scope.states, ("t",))
            starting = replace(own, model_names=begun)
            _check_map(given, "start", own.states, scope.states, starting, view, flaws)
        if flat:
            flaws.found = [
                (path[1:] if path[:1] == ("model",) else path, detail, kind)
                for path, detail, kind in flaws.found
            ]
        flaws.raise_any()
        assert plant is not None
        return plant


def _check_controls(scope: Scope, own: Scope, flaws: Flaws) -> None:
    if set(own.controls) != set(scope.controls):
        flaws.add(
            f"the plant has the controls {', '.join(own.controls)}, the problem {', '.join(scope.controls)}",
            "model",
            "controls",
        )


def _check_map(
    given: dict[str, Any],
    key: str,
    wanted: tuple[str, ...],
    same: tuple[str, ...],
    scope: Scope,
    view: bool,
    flaws: Flaws,
) -> None:
    """Every wanted name has an expression, or is the same on the other side, or the library knows."""
    table = mapping(given.get(key))
    for name, expression in table.items():
        if name not in wanted:
            flaws.add(unknown_key(name, "state", wanted, scope), key, name)
        else:
            check_expression(expression, "model", scope, flaws, key, name)
    missing = [name for name in wanted if name not in table and name not in same]
    if missing and not view:
        flaws.add(f"the state '{missing[0]}' has no expression", key)
