"""Fields with an inner structure: lists of names, tables by name, matrices, guesses."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from solvers.expressions import quoted
from solvers.models import LIBRARY
from solvers.spec.checks import check_bound, check_expression
from solvers.spec.faults import Flaws, kind_of, refuse
from solvers.spec.fields import BOUND_SCHEMA, VALUE_SCHEMA, Check
from solvers.spec.scope import MAX_NAME, Scope, mapping

MAX_UNIT = 200
MAX_DEFINITIONS = 1000
NAME_PATTERN = "^[A-Za-z][A-Za-z0-9_]*$"


def object_of(value: Any) -> dict[str, Any]:
    """Return ``value`` if it is an object; raises PydanticCustomError if not."""
    if not isinstance(value, dict):
        raise refuse(f"must be an object, not {kind_of(value)}")
    return value


def list_of(value: Any) -> list[Any]:
    """Return ``value`` if it is a list; raises PydanticCustomError if not."""
    if not isinstance(value, list):
        raise refuse(f"must be a list, not {kind_of(value)}")
    return value


def unknown_key(key: str, what: str, names: Collection[str], scope: Scope) -> str:
    """Return the sentence about a key that is not among ``names``."""
    return f"unknown {what} {quoted(key)}{scope.suggest(key, names)}"


@dataclass(frozen=True)
class NameList(Check):
    """A list of names; whether they clash with others is judged across the document."""

    what: str
    most: int
    least: int = 0

    def check(self, value: Any, scope: Scope) -> tuple[str, ...]:
        """Return the names."""
        names = list_of(value)
        flaws = Flaws()
        if len(names) < self.least:
            flaws.add(f"at least {self.least} {self.what} is needed")
        if len(names) > self.most:
            raise refuse(f"limit: at most {self.most} {self.what}s, not {len(names):,}", type="limit")
        for index, name in enumerate(names):
            if not isinstance(name, str):
                flaws.add(f"a name must be text, not {kind_of(name)}", index)
        flaws.raise_any()
        return tuple(names)

    def schema(self) -> dict[str, Any]:
        """A list of names."""
        items = {"type": "string", "pattern": NAME_PATTERN, "maxLength": MAX_NAME}
        return {"type": "array", "items": items, "minItems": self.least, "maxItems": self.most}


class FlexibleNames(NameList):
    """Names of coordinates that are elastic."""

    def check(self, value: Any, scope: Scope) -> tuple[str, ...]:
        """Return the names."""
        names, flaws = super().check(value, scope), Flaws()
        for index, name in enumerate(names):
            if scope.known and name not in scope.coordinates:
                flaws.add(unknown_key(name, "coordinate", scope.coordinates, scope), index)
            elif name in names[:index]:
                flaws.add(f"the coordinate {quoted(name)} stands twice", index)
        flaws.raise_any()
        return names


class ParameterTable(Check):
    """Name -> value; each may use earlier ones. The scope has evaluated them already."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        table = object_of(value)
        scope.parameter_flaws.raise_any()
        return table

    def schema(self) -> dict[str, Any]:
        """An object of values."""
        return {"type": "object", "additionalProperties": VALUE_SCHEMA}


class AxisValues(Check):
    """A list of values that may use parameters, one for each axis."""

    def check(self, value: Any, scope: Scope) -> list[Any]:
        """Return the values as submitted."""
        values, flaws = list_of(value), Flaws()
        if scope.known and len(values) != len(scope.axes):
            flaws.add(f"misshapen: one for each axis, {len(scope.axes)} in all, not {len(values)}")
        for index, item in enumerate(values[: len(scope.axes)]):
            check_expression(item, "parameter", scope, flaws, index)
        flaws.raise_any()
        return values

    def schema(self) -> dict[str, Any]:
        """A list of expressions."""
        return {"type": "array", "items": VALUE_SCHEMA}


class DefinitionTable(Check):
    """Name -> model expression; each may use earlier ones."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        table, flaws = object_of(value), Flaws()
        if len(table) > MAX_DEFINITIONS:
            raise refuse(f"limit: at most {MAX_DEFINITIONS:,} definitions, not {len(table):,}", type="limit")
        later = set(table)
        for name, expression in table.items():
            check_expression(expression, "model", scope, flaws, name, without=later)
            later.discard(name)
        flaws.raise_any()
        return table

    def schema(self) -> dict[str, Any]:
        """An object of expressions."""
        return {"type": "object", "additionalProperties": VALUE_SCHEMA}


class OverrideTable(ParameterTable):
    """Values for some parameters of a model of the library."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the overrides as submitted."""
        table = object_of(value)
        flaws = Flaws()
        for key in table if scope.known else ():
            if key not in scope.parameter_names:
                flaws.add(unknown_key(key, "parameter", scope.parameter_names, scope), key)
        _check_intervals(table, scope, flaws)
        flaws.found += scope.parameter_flaws.found
        flaws.raise_any()
        return table


def _check_intervals(table: dict[str, Any], scope: Scope, flaws: Flaws) -> None:
    """Parameters that are given to a model of the library lie where it makes sense."""
    for name, (lower, upper) in scope.parameter_intervals.items():
        value = scope.parameters.get(name)
        if name in table and value is not None and not lower <= value <= upper:
            flaws.add(f"must lie within [{lower:g}, {upper:g}], not {value:g}", name)


class OptionTable(Check):
    """Choices of structure of a model of the library."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the choices as submitted."""
        table, flaws = object_of(value), Flaws()
        name = mapping(scope.problem.get("model")).get("name")
        entry = LIBRARY.get(name) if isinstance(name, str) else None
        known = {} if entry is None else entry.options
        for key, chosen in table.items() if entry is not None else ():
            option = known.get(key)
            if option is None:
                flaws.add(unknown_key(key, "option", known, scope), key)
            elif not option.allows(chosen):
                choices = ", ".join(str(choice) for choice in option.choices)
                flaws.add(f"must be one of {choices}", key)
        flaws.raise_any()
        return table

    def schema(self) -> dict[str, Any]:
        """An object of whole numbers and words."""
        choice = {"anyOf": [{"type": "integer"}, {"type": "string"}]}
        return {"type": "object", "additionalProperties": choice}


class LibraryName(Check):
    """The name of a model of the library."""

    def check(self, value: Any, scope: Scope) -> str:
        """Return the name."""
        if isinstance(value, str) and value in LIBRARY:
            return value
        known = ", ".join(LIBRARY)
        if not isinstance(value, str):
            raise refuse(f"must be the name of a library model, not {kind_of(value)}; there are: {known}")
        raise refuse(f"unknown library model {quoted(value)}; there are: {known}")

    def schema(self) -> dict[str, Any]:
        """One of the names."""
        return {"type": "string", "enum": list(LIBRARY)}


class DynamicsTable(Check):
    """One model expression for every state: its rate of change."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table in the order of the states."""
        table, flaws = object_of(value), Flaws()
        for state, expression in table.items():
            if scope.known and state not in scope.states:
                flaws.add(unknown_key(state, "state", scope.states, scope), state)
            else:
                check_expression(expression, "model", scope, flaws, state)
        for state in scope.states:
            if state not in table:
                flaws.add(f"the state {quoted(state)} has no expression for its rate")
        flaws.raise_any()
        return {state: table[state] for state in scope.states} if scope.known else table

    def schema(self) -> dict[str, Any]:
        """An object of expressions."""
        return {"type": "object", "additionalProperties": VALUE_SCHEMA}


@dataclass(frozen=True)
class BoundTable(Check):
    """Name of a state (or control) -> bound; ``null`` is free, ``"*"`` may stand for all the others."""

    what: str
    star: bool = False

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        table, flaws = object_of(value), Flaws()
        names = {"state": scope.states, "control": scope.controls}.get(
            self.what, scope.states + scope.controls
        )
        for name, bound in table.items():
            if scope.known and name not in names and not (self.star and name == "*"):
                flaws.add(self._unknown(name, names, scope), name)
            elif bound is not None:
                check_bound(bound, scope, flaws, name)
        flaws.raise_any()
        return table

    def _unknown(self, name: str, names: tuple[str, ...], scope: Scope) -> str:
        if self.what == "control" and name in scope.states:
            return f"{quoted(name)} is a state; its ends are in initial_state and final_state"
        if name in scope.controls:
            return f"{quoted(name)} is a control; only states have values at the ends"
        return unknown_key(name, self.what, names, scope)

    def schema(self) -> dict[str, Any]:
        """An object of bounds."""
        bound = {"anyOf": [*BOUND_SCHEMA["anyOf"], {"type": "null"}]}
        return {"type": "object", "additionalProperties": bound}


class UnitTable(Check):
    """Name -> unit label."""

    def check(self, value: Any, scope: Scope) -> dict[str, str]:
        """Return the labels."""
        table, flaws = object_of(value), Flaws()
        for name, label in table.items():
            if scope.known and name not in scope.model_names | scope.output_names:
                flaws.add(unknown_key(name, "name", scope.model_names, scope), name)
            elif not isinstance(label, str):
                flaws.add(f"a unit must be text, not {kind_of(label)}", name)
            elif len(label) > MAX_UNIT:
                flaws.add(f"limit: a unit has at most {MAX_UNIT} characters", name, type="limit")
        flaws.raise_any()
        return table

    def schema(self) -> dict[str, Any]:
        """An object of labels."""
        label = {"type": "string", "maxLength": MAX_UNIT}
        return {"type": "object", "additionalProperties": label}
