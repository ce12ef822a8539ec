"""What an expression is evaluated over: CasADi SX symbols."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from solvers.expressions import LOOKUP
from solvers.formulation.data_table import DataTable


def look_up(table: DataTable, argument: Any) -> ca.SX:
    """The value of a data table, with exact derivatives: a tree of choices gives the numbers of the piece.

    All choices are evaluated whatever the argument is, about 20 operations for each point of the table.
    """
    argument = ca.SX(argument)
    below = [argument < float(edge) for edge in table.breaks]

    def chosen(numbers: Sequence[float], first: int = 0) -> ca.SX:
        """The number of the piece, of which the breaks before ``first`` are known to lie to the left."""
        if len(set(numbers)) == 1:  # NaN is equal to nothing but itself here
            return ca.SX(numbers[0])
        middle = len(numbers) // 2
        return ca.if_else(
            below[first + middle - 1],
            chosen(numbers[:middle], first),
            chosen(numbers[middle:], first + middle),
        )

    distance = argument - chosen(table.origins.tolist())
    highest, *others = table.coefficients.tolist()
    value = chosen(highest)
    for row in others:
        value = value * distance + chosen(row)
    return value


FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "asin": ca.asin,
    "acos": ca.acos,
    "atan": ca.atan,
    "atan2": ca.atan2,
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "tanh": ca.tanh,
    "exp": ca.exp,
    "log": ca.log,
    "sqrt": ca.sqrt,
    "abs": ca.fabs,
    "sign": ca.sign,
    "min": ca.fmin,
    "max": ca.fmax,
    LOOKUP: look_up,
}


class CasadiBackend:
    """Values are SX scalars (or floats where the model has constants)."""

    @property
    def functions(self) -> Mapping[str, Callable[..., Any]]:
        """CasADi's functions by the names of the expression language."""
        return FUNCTIONS

    def solve(self, matrix: Sequence[Sequence[Any]], right: Sequence[Any]) -> list[Any]:
        """Solve the system symbolically."""
        rows = [ca.horzcat(*[ca.SX(entry) for entry in row]) for row in matrix]
        solution = ca.solve(ca.vertcat(*rows), ca.vertcat(*[ca.SX(value) for value in right]))
        return [solution[index] for index in range(len(right))]


CASADI = CasadiBackend()
