"""Data tables: piecewise polynomials that expressions call, over floats, arrays, graphs and CasADi symbols.

``cubic`` is the spline with two continuous derivatives whose first two and last two pieces are one cubic each
("not-a-knot"; C. de Boor, A Practical Guide to Splines, 1978, chapter IV), so that a table of a cubic gives
that cubic. Two points give a straight line, three a parabola. Pieces are closed on the left: at a knot
``previous`` jumps to the value that stands there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from solvers.expressions import LOOKUP, Code, Expression

Vector = NDArray[np.float64]

# A time that is an end of the table but for rounding, relative to the span of the table, is that end.
_ROUNDING = 1e-9
_TIME = (Code.NAME, "t")


def calls(expression: Expression) -> Iterator[tuple[str, bool]]:
    """Yield the tables that an expression calls, and whether with the time itself, as in ``Td(t)``."""
    if expression.called:
        for before, (code, payload) in pairwise(expression.program):
            if code == Code.LOOKUP:
                yield payload, before == _TIME


def covered_times(expressions: Iterable[Expression], definitions: Mapping[str, Any]) -> tuple[float, float]:
    """Between which times all tables have values that end in an error and are called with the time itself.

    By these expressions, or by definitions that they need, each of which may need earlier ones.
    """
    if not any(isinstance(item, DataTable) and item.outside == "error" for item in definitions.values()):
        return -np.inf, np.inf
    needed = list(expressions)
    names = frozenset().union(*(item.names for item in needed))
    for name, item in reversed([*definitions.items()]):
        if name in names and isinstance(item, Expression):
            needed.append(item)
            names |= item.names
    tables = [definitions[name] for item in needed for name, in_time in calls(item) if in_time]
    ends = [(table.x[0], table.x[-1]) for table in tables if table.outside == "error"]
    return max((first for first, _ in ends), default=-np.inf), min((last for _, last in ends), default=np.inf)


@dataclass(frozen=True)
class DataTable:
    """Values over ascending ``x``; see :class:`solvers.models.Formula`, whose value is what is called.

    ``outside`` = "hold" continues with the values at the ends, "error" with NaN. ``names``: the parameters
    that x or values were expressions of.
    """

    x: tuple[float, ...]
    values: tuple[float, ...]
    interpolation: Literal["cubic", "linear", "previous"]
    outside: Literal["hold", "error"]
    names: frozenset[str] = frozenset()

    @property
    def text(self) -> str:
        """All its numbers: they are compiled into programs."""
        return f"{self.interpolation} {self.outside} {self.x} {self.values}"

    @property
    def has_corners(self) -> bool:
        """Whether it is less smooth than a spline."""
        return self.interpolation != "cubic" and len(set(self.values)) > 1

    def evaluate(self, values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
        """What an expression calls with one argument of the backend to which ``functions`` belong."""
        return partial(functions[LOOKUP], self)

    def __call__(self, argument: ArrayLike) -> Vector:
        """Values at arguments of any shape."""
        argument = np.asarray(argument, np.float64)
        piece = np.searchsorted(self.breaks, argument, side="right")
        distance = argument - self.origins[piece]
        value: Vector = self.coefficients[0, piece]
        for row in self.coefficients[1:]:
            value = value * distance + row[piece]
        return value

    @cached_property
    def breaks(self) -> Vector:
        """Where one piece ends and the next one begins, (K,); pieces 0 and K are outside of the table."""
        x = np.array(self.x)
        if self.outside == "hold":
            return x
        margin = _ROUNDING * (x[-1] - x[0])
        return np.concatenate([[x[0] - margin], x, [x[-1] + margin]])

    @cached_property
    def origins(self) -> Vector:
        """The point from which each piece counts its argument, (K + 1,)."""
        return np.pad(np.array(self.x), (1, 0) if self.outside == "hold" else (2, 1), mode="edge")

    @cached_property
    def coefficients(self) -> Vector:
        """Coefficients of each piece from its origin, the highest power first, (4, K + 1)."""
        inner = np.zeros((4, len(self.x) - 1))
        match self.interpolation:
            case "cubic":
                inner[:] = CubicSpline(self.x, self.values).c
            case "linear":
                inner[2] = np.diff(self.values) / np.diff(self.x)
                inner[3] = self.values[:-1]
            case "previous":
                inner[3] = self.values[:-1]
        ends = np.zeros((4, 2))
        ends[3] = self.values[0], self.values[-1]
        first, last = ends[:, :1], ends[:, 1:]
        if self.outside == "hold":
            return np.hstack([first, inner, last])
        nothing = np.array([[0.0], [0.0], [0.0], [np.nan]])
        return np.hstack([nothing, first, inner, last, nothing])
