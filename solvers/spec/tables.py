"""Fields with an inner structure: lists of names, tables by name, matrices, guesses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from solvers.expressions import quoted
from solvers.models import LIBRARY
from solvers.spec.checks import check_bound, check_constant, check_expression
from solvers.spec.faults import Flaws, kind_of, refuse
from solvers.spec.fields import BOUND_SCHEMA, VALUE_SCHEMA, Check
from solvers.spec.scope import Scope

MAX_STATES = 64
MAX_CONTROLS = 32
MAX_GUESS = 8195
NAME_PATTERN = "^[A-Za-z][A-Za-z0-9_]*$"


def object_of(value: Any) -> dict[Any, Any]:
    """Return ``value`` if it is an object; raises PydanticCustomError if not."""
    if not isinstance(value, dict):
        raise refuse(f"must be an object, not {kind_of(value)}")
    return value


def list_of(value: Any) -> list[Any]:
    """Return ``value`` if it is a list; raises PydanticCustomError if not."""
    if not isinstance(value, list | tuple):
        raise refuse(f"must be a list, not {kind_of(value)}")
    return list(value)


def unknown_key(key: Any, what: str, names: Iterable[str], scope: Scope) -> str:
    """Return the sentence about a key that is not among ``names``."""
    if not isinstance(key, str):
        return f"a key must be text, not {kind_of(key)}"
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
            flaws.add(f"limit: at most {self.most} {self.what}s, not {len(names):,}", type="limit")
        for index, name in enumerate(names):
            if not isinstance(name, str):
                flaws.add(f"a name must be text, not {kind_of(name)}", index)
        flaws.raise_any()
        return tuple(names)

    def schema(self) -> dict[str, Any]:
        """A list of names."""
        items = {"type": "string", "pattern": NAME_PATTERN, "maxLength": 200}
        return {"type": "array", "items": items, "minItems": self.least, "maxItems": self.most}


class ParameterTable(Check):
    """Name -> value; each may use earlier ones. The scope has evaluated them already."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        table = object_of(value)
        flaws = Flaws()
        for key in table:
            if not isinstance(key, str):
                flaws.add(unknown_key(key, "parameter", (), scope), str(key))
        flaws.found += scope.parameter_flaws.found
        flaws.raise_any()
        return table

    def schema(self) -> dict[str, Any]:
        """An object of values."""
        return {"type": "object", "additionalProperties": VALUE_SCHEMA}


class OverrideTable(ParameterTable):
    """Values for some parameters of a model of the library."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the overrides as submitted."""
        table = object_of(value)
        flaws = Flaws()
        for key in table if scope.known else ():
            if key not in scope.parameter_names:
                flaws.add(unknown_key(key, "parameter", scope.parameter_names, scope), str(key))
        flaws.found += scope.parameter_flaws.found
        flaws.raise_any()
        return table


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


@dataclass(frozen=True)
class MatrixOf(Check):
    """A list of rows of model expressions; one row for each coordinate, columns as ``columns`` says."""

    columns: str

    def check(self, value: Any, scope: Scope) -> tuple[tuple[Any, ...], ...]:
        """Return the rows."""
        if isinstance(value, dict):
            raise refuse(
                "unsupported: a matrix as diag or entries is not in this version", type="unsupported"
            )
        rows, flaws = list_of(value), Flaws()
        n = len(scope.coordinates) if scope.known else len(rows)
        m = (len(scope.controls) if scope.known else None) if self.columns == "controls" else n
        if len(rows) != n:
            flaws.add(f"misshapen: {n} rows are needed, one for each coordinate, not {len(rows)}")
        for i, row in enumerate(rows):
            if not isinstance(row, list | tuple):
                flaws.add(f"a row must be a list, not {kind_of(row)}", i)
                continue
            m = len(row) if m is None else m
            if len(row) != m:
                wanted = f"{m} entries, one for each {self.columns[:-1]}"
                flaws.add(f"misshapen: this row needs {wanted}, not {len(row)}", i)
            for j, entry in enumerate(row):
                check_expression(entry, "model", scope, flaws, i, j)
        flaws.raise_any()
        return tuple(map(tuple, rows))

    def schema(self) -> dict[str, Any]:
        """A list of lists of expressions."""
        return {"type": "array", "items": {"type": "array", "items": VALUE_SCHEMA}}


class ForceVector(Check):
    """A list of model expressions, one for each coordinate."""

    def check(self, value: Any, scope: Scope) -> tuple[Any, ...]:
        """Return the entries."""
        entries, flaws = list_of(value), Flaws()
        if scope.known and len(entries) != len(scope.coordinates):
            wanted = f"{len(scope.coordinates)} entries are needed, one for each coordinate"
            flaws.add(f"misshapen: {wanted}, not {len(entries)}")
        for i, entry in enumerate(entries):
            check_expression(entry, "model", scope, flaws, i)
        flaws.raise_any()
        return tuple(entries)

    def schema(self) -> dict[str, Any]:
        """A list of expressions."""
        return {"type": "array", "items": VALUE_SCHEMA}


class DynamicsTable(Check):
    """One model expression for every state: its rate of change."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table in the order of the states."""
        table, flaws = object_of(value), Flaws()
        for state, expression in table.items():
            if scope.known and state not in scope.states:
                flaws.add(unknown_key(state, "state", scope.states, scope), str(state))
            else:
                check_expression(expression, "model", scope, flaws, str(state))
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
        names = scope.states if self.what == "state" else scope.states + scope.controls
        for name, bound in table.items():
            if scope.known and name not in names and not (self.star and name == "*"):
                flaws.add(self._unknown(name, names, scope), str(name))
            elif bound is not None:
                check_bound(bound, scope, flaws, str(name))
        flaws.raise_any()
        return table

    def _unknown(self, name: Any, names: tuple[str, ...], scope: Scope) -> str:
        if name in scope.controls:
            return f"{quoted(name)} is a control; only states have values at the ends"
        return unknown_key(name, self.what, names, scope)

    def schema(self) -> dict[str, Any]:
        """An object of bounds."""
        bound = {"anyOf": [*BOUND_SCHEMA["anyOf"], {"type": "null"}]}
        return {"type": "object", "additionalProperties": bound}


@dataclass(frozen=True)
class HistoryTable(Check):
    """Name -> values over time: a list, or ``{"times": [...], "values": [...]}``."""

    what: str

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        table, flaws = object_of(value), Flaws()
        names = scope.states if self.what == "state" else scope.controls
        for name, history in table.items():
            if scope.known and name not in names:
                flaws.add(unknown_key(name, self.what, names, scope), str(name))
            elif isinstance(history, dict):
                self._check_timed(history, scope, flaws, str(name))
            else:
                check_values(history, scope, flaws, str(name))
        flaws.raise_any()
        return table

    def _check_timed(self, history: dict[Any, Any], scope: Scope, flaws: Flaws, name: str) -> None:
        for key in history:
            if key not in ("times", "values"):
                flaws.add(unknown_key(key, "key", ("times", "values"), scope), name, str(key))
        for key in ("times", "values"):
            if key not in history:
                flaws.add(f"the key '{key}' is required beside the other", name)
        times, values = history.get("times"), history.get("values")
        check_times(times, scope, flaws, name, "times")
        check_values(values, scope, flaws, name, "values")
        if isinstance(times, list) and isinstance(values, list) and len(times) != len(values):
            flaws.add(f"{len(times)} times for {len(values)} values", name)

    def schema(self) -> dict[str, Any]:
        """An object of lists."""
        values: dict[str, Any] = {
            "type": "array",
            "items": VALUE_SCHEMA,
            "minItems": 1,
            "maxItems": MAX_GUESS,
        }
        timed: dict[str, Any] = {"type": "object", "properties": {"times": values, "values": values}}
        timed |= {"required": ["times", "values"], "additionalProperties": False}
        return {"type": "object", "additionalProperties": {"anyOf": [values, timed]}}


def check_values(value: Any, scope: Scope, flaws: Flaws, *path: str | int) -> list[float | None]:
    """Check a list of 1 to 8,195 values; return what they are worth."""
    if not isinstance(value, list | tuple):
        flaws.add(f"must be a list of values, not {kind_of(value)}", *path)
    elif not value:
        flaws.add("at least one value is needed", *path)
    elif len(value) > MAX_GUESS:
        flaws.add(f"limit: a guess has at most {MAX_GUESS:,} values, not {len(value):,}", *path, type="limit")
    else:
        return [check_constant(item, scope, flaws, *path, i) for i, item in enumerate(value)]
    return []


def check_times(value: Any, scope: Scope, flaws: Flaws, *path: str | int) -> None:
    """Check a list of ascending times."""
    times = check_values(value, scope, flaws, *path)
    for i in range(1, len(times)):
        before, after = times[i - 1], times[i]
        if before is not None and after is not None and after <= before:
            flaws.add(f"times ascend, but {after:g} comes after {before:g}", *path, i)
            return


class TimeList(Check):
    """Ascending times of a guess."""

    def check(self, value: Any, scope: Scope) -> list[Any]:
        """Return the times as submitted."""
        flaws = Flaws()
        check_times(value, scope, flaws)
        flaws.raise_any()
        return list(value)

    def schema(self) -> dict[str, Any]:
        """A list of values."""
        return {"type": "array", "items": VALUE_SCHEMA, "minItems": 1, "maxItems": MAX_GUESS}


class UnitTable(Check):
    """Name -> unit label."""

    def check(self, value: Any, scope: Scope) -> dict[str, str]:
        """Return the labels."""
        table, flaws = object_of(value), Flaws()
        for name, label in table.items():
            if scope.known and name not in scope.model_names:
                flaws.add(unknown_key(name, "name", scope.model_names, scope), str(name))
            elif not isinstance(label, str):
                flaws.add(f"a unit must be text, not {kind_of(label)}", str(name))
            elif len(label) > 200:
                flaws.add("limit: a unit has at most 200 characters", str(name), type="limit")
        flaws.raise_any()
        return table

    def schema(self) -> dict[str, Any]:
        """An object of labels."""
        label = {"type": "string", "maxLength": 200}
        return {"type": "object", "additionalProperties": label}
