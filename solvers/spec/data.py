"""Data tables of a document: points of a curve that expressions may call."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from solvers.expressions import parse
from solvers.formulation.data_table import DataTable
from solvers.spec.base import SpecModel
from solvers.spec.checks import check_constant
from solvers.spec.faults import Flaws, Path, refuse
from solvers.spec.fields import VALUE_SCHEMA, Check, Choice
from solvers.spec.scope import Scope, mapping
from solvers.spec.tables import list_of
from solvers.spec.values import Value, evaluate_constant

MAX_TABLES = 64
MAX_POINTS = 2000


class Points(Check):
    """2 to 2,000 numbers or constant expressions."""

    def check(self, value: Any, scope: Scope) -> list[Any]:
        """Return the values as submitted."""
        values, flaws = list_of(value), Flaws()
        if len(values) > MAX_POINTS:
            raise refuse(
                f"limit: a data table has at most {MAX_POINTS:,} points, not {len(values):,}", type="limit"
            )
        if len(values) < 2:
            raise refuse("a data table has at least 2 points")
        self._check_all(
            [check_constant(item, scope, flaws, index) for index, item in enumerate(values)], flaws
        )
        flaws.raise_any()
        return values

    def _check_all(self, numbers: list[float | None], flaws: Flaws) -> None:
        """Nothing more is asked of values."""

    def schema(self) -> dict[str, Any]:
        """A list of values."""
        return {"type": "array", "items": VALUE_SCHEMA, "minItems": 2, "maxItems": MAX_POINTS}


class AscendingPoints(Points):
    """Points of which each is larger than the one before."""

    def _check_all(self, numbers: list[float | None], flaws: Flaws) -> None:
        for index, (before, after) in enumerate(pairwise(numbers), 1):
            if before is not None and after is not None and after <= before:
                flaws.add(f"x ascends, but {after:g} comes after {before:g}", index)
                return


class DataTableSpec(SpecModel):
    """A curve through points; expressions along the trajectory call it by its name with one argument."""

    x: Annotated[list[Value], AscendingPoints()]
    """Ascending arguments."""
    values: Annotated[list[Value], Points()]
    """The value at each of ``x``."""
    interpolation: Annotated[
        Literal["cubic", "linear", "previous"], Choice(("cubic", "linear", "previous"))
    ] = "cubic"
    """A cubic spline (not-a-knot), straight lines, or steps that begin at their ``x``."""
    outside: Annotated[Literal["hold", "error"], Choice(("hold", "error"))] = "hold"
    """Beyond the ends: the value at the end, or none, so that the solve ends as ``evaluation_error``."""

    def table(self, parameters: dict[str, float]) -> DataTable:
        """Return the table with its numbers."""
        x, values = (
            tuple(evaluate_constant(item, parameters) for item in items) for items in (self.x, self.values)
        )
        names = frozenset().union(*(parse(item).names for item in (*self.x, *self.values)))
        return DataTable(x, values, self.interpolation, self.outside, names)


def check_data(scope: Scope, flaws: Flaws) -> None:
    """Every table has as many values as arguments; there are at most 64 tables."""
    tables, place = mapping(scope.problem.get("data")), ("problem", "data")
    if len(tables) > MAX_TABLES:
        detail = f"limit: at most {MAX_TABLES} data tables, not {len(tables):,}"
        flaws.add(detail, *place, type="limit")
        return
    for name, item in tables.items():
        x, values = mapping(item).get("x"), mapping(item).get("values")
        if isinstance(x, list) and isinstance(values, list) and len(x) != len(values):
            where: Path = (*place, name, "values")
            flaws.add(f"{len(values)} values for {len(x)} arguments x", *where)
