"""What an expression is evaluated over: CasADi SX symbols."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

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
