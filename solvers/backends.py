"""What an expression is evaluated over: the functions and the linear solve of NumPy arrays.

The counterpart over CasADi symbols is :mod:`solvers.symbolic`; problems are written once, for both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from solvers.expressions import LOOKUP, NUMPY_FUNCTIONS


class Backend(Protocol):
    """The few operations that a model needs besides arithmetic."""

    @property
    def functions(self) -> Mapping[str, Callable[..., Any]]:
        """The functions that an expression may call, by name."""
        ...

    def solve(self, matrix: Sequence[Sequence[Any]], right: Sequence[Any]) -> list[Any]:
        """Solve a square linear system whose entries are values of this backend."""
        ...


_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    **NUMPY_FUNCTIONS,
    LOOKUP: lambda table, argument: table(argument),
}


class NumpyBackend:
    """Values are floats or arrays of one shape (K,): one number for each place."""

    @property
    def functions(self) -> Mapping[str, Callable[..., Any]]:
        """NumPy's functions by the names of the expression language; data tables look up by themselves."""
        return _FUNCTIONS

    def solve(self, matrix: Sequence[Sequence[Any]], right: Sequence[Any]) -> list[Any]:
        """Solve K systems at once; a singular one yields NaN at its place."""
        size = len(right)
        if size == 2:
            return _solve_pair(*matrix[0], *matrix[1], *right)
        entries = np.broadcast_arrays(*[entry for row in matrix for entry in row], *right)
        stacked = np.moveaxis(np.asarray(entries[: size * size], np.float64), 0, -1)
        stacked = stacked.reshape(*stacked.shape[:-1], size, size)
        vectors = np.moveaxis(np.asarray(entries[size * size :], np.float64), 0, -1)[..., None]
        try:
            solved = np.linalg.solve(stacked, vectors)
        except np.linalg.LinAlgError:
            regular = np.linalg.matrix_rank(stacked) == size
            safe = np.where(regular[..., None, None], stacked, np.eye(size))
            solved = np.where(regular[..., None, None], np.linalg.solve(safe, vectors), np.nan)
        return list(np.moveaxis(solved[..., 0], -1, 0))


def _solve_pair(a: Any, b: Any, c: Any, d: Any, e: Any, f: Any) -> list[Any]:
    """Solve [[a, b], [c, d]] (x, y) = (e, f) at K places by elimination with row pivoting.

    LAPACK is called once for each place, which takes many times as long.
    """
    swap = np.abs(c) > np.abs(a)
    if np.any(swap):
        a, c = np.where(swap, c, a), np.where(swap, a, c)
        b, d = np.where(swap, d, b), np.where(swap, b, d)
        e, f = np.where(swap, f, e), np.where(swap, e, f)
    with np.errstate(all="ignore"):
        factor = c / a
        pivot = d - factor * b
        y = np.where(pivot == 0.0, np.nan, (f - factor * e) / pivot)
        return [(e - b * y) / a, y]


NUMPY = NumpyBackend()
