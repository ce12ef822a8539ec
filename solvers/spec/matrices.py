"""Matrices and vectors of a mechanical model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from solvers.spec.checks import check_expression
from solvers.spec.faults import Flaws, kind_of, refuse
from solvers.spec.fields import VALUE_SCHEMA, Check
from solvers.spec.scope import MAX_STATES, Scope
from solvers.spec.tables import list_of


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
            flaws.add(f"misshapen: rows are one for each coordinate, {n} in all, not {len(rows)}")
        for i, row in enumerate(rows[:MAX_STATES]):
            if not isinstance(row, list):
                flaws.add(f"a row must be a list, not {kind_of(row)}", i)
                continue
            m = len(row) if m is None else m
            if len(row) != m:
                wanted = f"one for each {self.columns[:-1]}, {m} in all"
                flaws.add(f"misshapen: entries of a row are {wanted}, not {len(row)}", i)
            for j, entry in enumerate(row[:MAX_STATES]):
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
            wanted = f"one for each coordinate, {len(scope.coordinates)} in all"
            flaws.add(f"misshapen: entries are {wanted}, not {len(entries)}")
        for i, entry in enumerate(entries[:MAX_STATES]):
            check_expression(entry, "model", scope, flaws, i)
        flaws.raise_any()
        return tuple(entries)

    def schema(self) -> dict[str, Any]:
        """A list of expressions."""
        return {"type": "array", "items": VALUE_SCHEMA}
