"""Matrices and vectors of a mechanical model: lists of rows, diagonals, or single entries."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from solvers.expressions import quoted
from solvers.spec.checks import check_expression, is_number
from solvers.spec.faults import Flaws, Path, kind_of
from solvers.spec.fields import VALUE_SCHEMA, Check
from solvers.spec.scope import MAX_STATES, Scope
from solvers.spec.tables import list_of
from solvers.spec.values import Value

Row = tuple[Value, ...]
Matrix = tuple[Row, ...] | Mapping[str, Any]
"""As submitted: rows, ``{"diag": [...]}``, or ``{"entries": [[i, j, value], ...], "symmetric": true}``."""

_ONE = {"coordinates": "coordinate", "axes": "axis", "controls": "control"}
_KEYS = ("diag", "entries", "symmetric")


def places(matrix: Matrix) -> Iterator[tuple[Path, int, int, Value]]:
    """Yield every entry of a checked matrix: its place in the document, its row and column, its value."""
    if not isinstance(matrix, Mapping):
        for i, row in enumerate(matrix):
            for j, entry in enumerate(row):
                yield (i, j), i, j, entry
        return
    for i, entry in enumerate(matrix.get("diag", ())):
        yield ("diag", i), i, i, entry
    for index, (i, j, entry) in enumerate(matrix.get("entries", ())):
        yield ("entries", index, 2), int(i), int(j), entry
        if matrix.get("symmetric") and i != j:
            yield ("entries", index, 2), int(j), int(i), entry


def matrix_rows(matrix: Matrix, rows: int, columns: int) -> tuple[Row, ...]:
    """Return all rows of a checked matrix, zeros where it names no entry."""
    full: list[list[Value]] = [[0] * columns for _ in range(rows)]
    for _, i, j, entry in places(matrix):
        full[i][j] = entry
    return tuple(map(tuple, full))


@dataclass(frozen=True)
class MatrixOf(Check):
    """A matrix of expressions at ``place``; a row for each of ``rows``, a column for each of ``columns``."""

    columns: str
    rows: str = "coordinates"
    place: str = "model"

    def check(self, value: Any, scope: Scope) -> Matrix:
        """Return the matrix as submitted."""
        flaws = Flaws()
        if isinstance(value, dict):
            self._check_sparse(value, scope, flaws)
            flaws.raise_any()
            return value
        rows = list_of(value)
        n, m = self._shape(scope)
        n = len(rows) if n is None else n
        m = n if m is None and self.columns == self.rows else m
        if len(rows) != n:
            flaws.add(f"misshapen: rows are one for each {_ONE[self.rows]}, {n} in all, not {len(rows)}")
        for i, row in enumerate(rows[:MAX_STATES]):
            if not isinstance(row, list):
                flaws.add(f"a row must be a list, not {kind_of(row)}", i)
                continue
            m = len(row) if m is None else m
            if len(row) != m:
                wanted = f"one for each {_ONE[self.columns]}, {m} in all"
                flaws.add(f"misshapen: entries of a row are {wanted}, not {len(row)}", i)
            for j, entry in enumerate(row[:MAX_STATES]):
                check_expression(entry, self.place, scope, flaws, i, j)
        flaws.raise_any()
        return tuple(map(tuple, rows))

    def _shape(self, scope: Scope) -> tuple[int | None, int | None]:
        """The numbers of rows and columns, None where the names are not known."""
        if not scope.known:
            return None, None
        sizes = {"coordinates": scope.coordinates, "axes": scope.axes, "controls": scope.controls}
        return len(sizes[self.rows]), len(sizes[self.columns])

    def _check_sparse(self, value: dict[str, Any], scope: Scope, flaws: Flaws) -> None:
        for key in value:
            if key not in _KEYS:
                flaws.add(f"unknown key {quoted(key)}{scope.suggest(key, _KEYS)}", key)
        if ("diag" in value) == ("entries" in value):
            flaws.add("a matrix is a list of rows, or has either 'diag' or 'entries'")
        elif "diag" in value:
            self._check_diagonal(value["diag"], scope, flaws)
        else:
            self._check_entries(value["entries"], value.get("symmetric", False), scope, flaws)
        if "symmetric" in value and not isinstance(value["symmetric"], bool):
            flaws.add(f"must be true or false, not {kind_of(value['symmetric'])}", "symmetric")
        elif "symmetric" in value and "entries" not in value:
            flaws.add("goes with 'entries' only", "symmetric")

    def _check_diagonal(self, value: Any, scope: Scope, flaws: Flaws) -> None:
        if not isinstance(value, list):
            flaws.add(f"must be a list, not {kind_of(value)}", "diag")
            return
        n, m = self._shape(scope)
        if n != m:
            flaws.add(f"misshapen: a matrix of {n} rows and {m} columns has no diagonal form", "diag")
        elif n is not None and len(value) != n:
            flaws.add(f"misshapen: one for each {_ONE[self.rows]}, {n} in all, not {len(value)}", "diag")
        for i, entry in enumerate(value[:MAX_STATES]):
            check_expression(entry, self.place, scope, flaws, "diag", i)

    def _check_entries(self, value: Any, symmetric: Any, scope: Scope, flaws: Flaws) -> None:
        if not isinstance(value, list):
            flaws.add(f"must be a list, not {kind_of(value)}", "entries")
            return
        shape = self._shape(scope)
        if symmetric is True and shape[0] != shape[1]:
            flaws.add(f"a matrix of {shape[0]} rows and {shape[1]} columns is not symmetric", "symmetric")
        seen: set[tuple[int, int]] = set()
        for index, entry in enumerate(value[: MAX_STATES**2]):
            if not isinstance(entry, list) or len(entry) != 3:
                flaws.add("an entry is [row, column, value]", "entries", index)
                continue
            if not self._check_indices(entry, shape, flaws, index):
                continue
            here = {(int(entry[0]), int(entry[1]))}
            if symmetric is True:
                here.add((int(entry[1]), int(entry[0])))
            if here & seen:
                flaws.add(f"the entry {entry[0]:g}, {entry[1]:g} stands twice", "entries", index)
            seen |= here
            check_expression(entry[2], self.place, scope, flaws, "entries", index, 2)
        if len(value) > MAX_STATES**2:
            flaws.add(
                f"limit: at most {MAX_STATES**2:,} entries, not {len(value):,}", "entries", type="limit"
            )

    @staticmethod
    def _check_indices(
        entry: Sequence[Any], shape: tuple[int | None, int | None], flaws: Flaws, index: int
    ) -> bool:
        before = len(flaws.found)
        for axis, (number, size) in enumerate(zip(entry, shape, strict=False)):
            if not is_number(number) or not float(number).is_integer():
                flaws.add("an index is a whole number, counted from 0", "entries", index, axis)
            elif not 0 <= number < (MAX_STATES if size is None else size):
                flaws.add(
                    f"the index {number:g} is not among 0 ... {(size or 1) - 1}", "entries", index, axis
                )
        return len(flaws.found) == before

    def schema(self) -> dict[str, Any]:
        """Rows, a diagonal, or entries."""
        values = {"type": "array", "items": VALUE_SCHEMA}
        entry = {"type": "array", "minItems": 3, "maxItems": 3}
        return {
            "anyOf": [
                {"type": "array", "items": values},
                {
                    "type": "object",
                    "properties": {"diag": values},
                    "required": ["diag"],
                    "additionalProperties": False,
                },
                {
                    "type": "object",
                    "properties": {
                        "entries": {"type": "array", "items": entry},
                        "symmetric": {"type": "boolean"},
                    },
                    "required": ["entries"],
                    "additionalProperties": False,
                },
            ]
        }


class ForceVector(Check):
    """A list of model expressions, one for each coordinate."""

    def check(self, value: Any, scope: Scope) -> tuple[Any, ...]:
        """Return the entries."""
        entries, flaws = list_of(value), Flaws()
        if scope.known and len(entries) != len(scope.coordinates):
            wanted = f"one for each coordinate, {len(scope.coordinates)} in all"
            flaws.add(f"misshapen: entries are {wanted}, not {len(entries)}")
        for i, entry in enumerate(entries[:MAX_STATES]):
            check_expression(entry, "model", scope, flaws, i)
        flaws.raise_any()
        return tuple(entries)

    def schema(self) -> dict[str, Any]:
        """A list of expressions."""
        return {"type": "array", "items": VALUE_SCHEMA}
