"""Puts a nonlinear program together: blocks of unknowns, functions of places, rows of constraints.

Structure and numbers are kept apart. Matrices and functions are built once; every vector (initial values,
bounds, the columns P) is a function of the transcription, asked anew for each program. So a builder serves
all problems of one structure: :attr:`Transcription.key` says which these are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from solvers.program import NonlinearProgram, PlaceFunction

Vector = NDArray[np.float64]
Matrix = sparse.csr_array

Numbers = Callable[[Any], ArrayLike]
"""A vector or matrix of numbers, from the transcription that wants a program."""

Intervals = Callable[[Any], tuple[ArrayLike, ArrayLike]]
"""Lower and upper bounds, from the transcription that wants a program."""


def fixed(lower: float, upper: float) -> Intervals:
    """Bounds that are the same for every problem."""
    return lambda _: (lower, upper)


@dataclass(frozen=True)
class Places:
    """A function applied to K places, before the rows that it enters are known."""

    index: int
    values: int
    """K n_y, the number of values, place after place."""


@dataclass(frozen=True)
class _Unknowns:
    start: int
    shape: tuple[int, int]
    scale: Vector
    initial: Numbers
    bounds: Intervals


@dataclass(frozen=True)
class _Held:
    """Unknowns held by bounds of their own, divided by ``entries``; ``wanted``: which of the given rows."""

    unknowns: NDArray[np.int64]
    entries: Vector
    wanted: NDArray[np.bool_]
    bounds: Intervals


@dataclass
class _Function:
    function: ca.Function
    gather: Matrix
    numbers: Numbers
    cost: Vector
    scatter: list[tuple[int, sparse.csc_array]] = field(default_factory=list)


@dataclass(frozen=True)
class _Rows:
    matrix: Matrix
    bounds: Intervals
    wanted: NDArray[np.bool_] | None
    scale: Vector


@dataclass
class ProgramBuilder:
    """Unknowns first (:meth:`unknowns`), then functions, costs and constraints over them.

    ``blocks`` and ``places`` keep by name what a transcription wants to find again.
    """

    blocks: dict[str, list[range]] = field(default_factory=dict)
    places: dict[str, Places] = field(default_factory=dict)
    size: int = 0
    row_count: int = 0
    _unknowns: list[_Unknowns] = field(default_factory=list)
    _held: list[_Held] = field(default_factory=list)
    _functions: list[_Function] = field(default_factory=list)
    _rows: list[_Rows] = field(default_factory=list)
    _structure: NonlinearProgram | None = None

    def unknowns(
        self, name: str, shape: tuple[int, int], *, scale: ArrayLike, initial: Numbers, bounds: Intervals
    ) -> None:
        """Append blocks of unknowns, ``shape`` = (blocks, length of each), under ``name``.

        ``scale`` has an entry for each block; ``initial`` and ``bounds`` give arrays that broadcast to shape.
        """
        count, length = shape
        self.blocks[name] = [
            range(self.size + i * length, self.size + (i + 1) * length) for i in range(count)
        ]
        if not count:
            return
        scales = np.broadcast_to(np.asarray(scale, np.float64), (count,))
        self._unknowns.append(_Unknowns(self.size, shape, np.repeat(scales, length), initial, bounds))
        self.size += count * length

    def rows_of(self, block: range, matrix: Matrix | None = None) -> Matrix:
        """Spread ``matrix`` (K x len(block)), by default the identity, over all unknowns: K x size."""
        if matrix is None:
            return self.single_rows(np.arange(block.start, block.stop))
        rows = sparse.csr_array(matrix)
        return sparse.csr_array(
            (rows.data, rows.indices + block.start, rows.indptr), shape=(rows.shape[0], self.size)
        )

    def single_rows(self, unknowns: NDArray[np.int64]) -> Matrix:
        """Rows that are one unknown each: K x size."""
        parts = np.ones(unknowns.size), unknowns, np.arange(unknowns.size + 1)
        return sparse.csr_array(parts, shape=(unknowns.size, self.size))

    def apply(self, function: ca.Function, blocks: Sequence[Matrix], numbers: Numbers) -> Places:
        """Apply F(z, p) to K places: ``blocks`` has K rows a local variable, ``numbers`` gives n_p x K."""
        places = blocks[0].shape[0]
        order = np.arange(places * len(blocks)).reshape(len(blocks), places).T.ravel()
        gather = sparse.csr_array(sparse.vstack(blocks, format="csr")[order])
        values = places * function.size1_out(0)
        self._functions.append(_Function(function, gather, numbers, np.zeros(values)))
        return Places(len(self._functions) - 1, values)

    def cost(self, places: Places, weights: Vector) -> None:
        """Add weights' F to the objective."""
        self._functions[places.index].cost += weights

    def constrain(
        self,
        bounds: Intervals,
        *,
        scale: ArrayLike,
        linear: Matrix | None = None,
        places: Places | None = None,
        scatter: Matrix | None = None,
        wanted: NDArray[np.bool_] | None = None,
    ) -> None:
        """Add rows ``lower <= linear w + scatter F <= upper``, each to be divided by its ``scale``.

        ``scatter`` (rows x values of ``places``) is the identity by default. ``wanted`` says which entries of
        the bounds belong to the rows, where these are not all.
        """
        if scatter is None and places is not None:
            scatter = sparse.csr_array(sparse.eye_array(places.values))
        part = linear if linear is not None else scatter
        assert part is not None
        count = part.shape[0]
        if count == 0:
            return
        scales = np.broadcast_to(np.asarray(scale, np.float64), (count,))
        matrix = sparse.csr_array((count, self.size)) if linear is None else sparse.csr_array(linear)
        self._rows.append(_Rows(matrix, bounds, wanted, scales))
        if places is not None and scatter is not None:
            self._functions[places.index].scatter.append((self.row_count, sparse.csc_array(scatter)))
        self.row_count += count

    def hold(self, this: Any, rows: Matrix, bounds: Intervals, *, scale: float) -> None:
        """Hold ``rows`` w within bounds: through bounds of unknowns where a row is a single unknown."""
        lower, upper = _both(bounds, this, (rows.shape[0],))
        wanted = np.isfinite(lower) | np.isfinite(upper)
        rows = sparse.csr_array(rows)
        rows.eliminate_zeros()
        single = wanted & (np.diff(rows.indptr) == 1)
        entries = rows[single]
        self._held.append(_Held(entries.indices.astype(np.int64), entries.data, single, bounds))
        several = wanted & ~single
        self.constrain(bounds, scale=scale, linear=sparse.csr_array(rows[several]), wanted=several)

    def program(self, this: Any, objective_scale: float, initial: Vector | None = None) -> NonlinearProgram:
        """The program of the transcription ``this``, in scaled unknowns, rows and objective.

        ``initial``: the scaled unknowns to begin with, by default what the transcription says.
        """
        if self._structure is None:
            self._structure = self._assemble(this, objective_scale)
        structure, scale = self._structure, self.scale
        lower, upper = self._unknown_bounds(this)
        if initial is None:
            initial = self._initial(this, lower, upper) / scale
        row_bounds = [self._row_bounds(this, rows) for rows in self._rows]
        groups = [
            replace(group, numbers=np.asarray(item.numbers(this), np.float64))
            for group, item in zip(structure.groups, self._functions, strict=True)
        ]
        return replace(
            structure,
            initial=initial,
            lower=lower / scale,
            upper=upper / scale,
            constraint_lower=np.concatenate([np.empty(0), *(bounds[0] for bounds in row_bounds)]),
            constraint_upper=np.concatenate([np.empty(0), *(bounds[1] for bounds in row_bounds)]),
            groups=tuple(groups),
        )

    @property
    def scale(self) -> Vector:
        """What a scaled unknown is multiplied by to give the unknown."""
        return np.concatenate([item.scale for item in self._unknowns])

    def adjoint(self, places: Places, scaled_multipliers: Vector) -> Vector:
        """B' lambda for the values of ``places``, with the multipliers of the rows before their scaling."""
        multipliers = scaled_multipliers / np.concatenate([rows.scale for rows in self._rows])
        values = np.zeros(places.values)
        for start, matrix in self._functions[places.index].scatter:
            values += matrix.T @ multipliers[start : start + matrix.shape[0]]
        return values

    def _initial(self, this: Any, lower: Vector, upper: Vector) -> Vector:
        parts = [np.broadcast_to(item.initial(this), item.shape).ravel() for item in self._unknowns]
        inside: Vector = np.clip(np.concatenate(parts), lower, upper)
        return inside

    def _unknown_bounds(self, this: Any) -> tuple[Vector, Vector]:
        pairs = [_both(item.bounds, this, item.shape) for item in self._unknowns]
        lower = np.concatenate([pair[0].ravel() for pair in pairs])
        upper = np.concatenate([pair[1].ravel() for pair in pairs])
        for held in self._held:
            below, above = _both(held.bounds, this, held.wanted.shape)
            first, second = below[held.wanted] / held.entries, above[held.wanted] / held.entries
            np.maximum.at(lower, held.unknowns, np.minimum(first, second))
            np.minimum.at(upper, held.unknowns, np.maximum(first, second))
        return lower, upper

    @staticmethod
    def _row_bounds(this: Any, rows: _Rows) -> tuple[Vector, Vector]:
        shape = rows.scale.shape if rows.wanted is None else rows.wanted.shape
        lower, upper = _both(rows.bounds, this, shape)
        if rows.wanted is not None:
            lower, upper = lower[rows.wanted], upper[rows.wanted]
        return lower / rows.scale, upper / rows.scale

    def _assemble(self, this: Any, objective_scale: float) -> NonlinearProgram:
        """The matrices and functions, scaled; its vectors are placeholders."""
        nothing, no_rows = np.zeros(self.size), np.zeros(self.row_count)
        program = NonlinearProgram(
            initial=nothing,
            lower=nothing,
            upper=nothing,
            linear=sparse.csr_array(
                sparse.vstack(
                    [sparse.csr_array((0, self.size)), *(rows.matrix for rows in self._rows)], format="csr"
                )
            ),
            linear_cost=nothing,
            constraint_lower=no_rows,
            constraint_upper=no_rows,
            groups=tuple(self._place_function(item, this) for item in self._functions),
        )
        row_scale = 1.0 / np.concatenate([no_rows[:0], *(rows.scale for rows in self._rows)])
        return program.scaled(self.scale, row_scale, 1.0 / objective_scale)

    def _place_function(self, item: _Function, this: Any) -> PlaceFunction:
        scatter = sparse.coo_array((self.row_count, item.cost.size))
        if item.scatter:
            parts = [(start, sparse.coo_array(matrix)) for start, matrix in item.scatter]
            scatter = sparse.coo_array(
                (
                    np.concatenate([part.data for _, part in parts]),
                    (
                        np.concatenate([part.row + start for start, part in parts]),
                        np.concatenate([part.col for _, part in parts]),
                    ),
                ),
                shape=scatter.shape,
            )
        numbers = np.asarray(item.numbers(this), np.float64)
        return PlaceFunction(item.function, item.gather, numbers, sparse.csc_array(scatter), item.cost)


def _both(bounds: Intervals, this: Any, shape: tuple[int, ...]) -> tuple[Vector, Vector]:
    lower, upper = bounds(this)
    return _filled(lower, shape), _filled(upper, shape)


def _filled(values: ArrayLike, shape: tuple[int, ...]) -> Vector:
    """The values, repeated to this shape."""
    given = np.asarray(values, np.float64)
    if given.shape == shape:
        return given
    filled = np.empty(shape)
    filled[...] = given
    return filled
