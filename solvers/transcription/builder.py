"""Puts a nonlinear program together: blocks of unknowns, functions of places, rows of constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from solvers.program import NonlinearProgram, PlaceFunction

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """A function applied to K places, before the rows that it enters are known."""

    index: int
    values: int
    """K n_y, the number of values, place after place."""


@dataclass
class _Function:
    function: ca.Function
    gather: sparse.csr_array
    numbers: Vector
    cost: Vector
    scatter: list[tuple[int, sparse.csc_array]] = field(default_factory=list)


@dataclass
class ProgramBuilder:
    """Unknowns first (:meth:`unknowns`), then functions, costs and constraints over them."""

    _initial: list[Vector] = field(default_factory=list)
    _lower: list[Vector] = field(default_factory=list)
    _upper: list[Vector] = field(default_factory=list)
    _scale: list[Vector] = field(default_factory=list)
    _functions: list[_Function] = field(default_factory=list)
    _rows: list[tuple[sparse.csr_array, Vector, Vector, Vector]] = field(default_factory=list)
    size: int = 0
    row_count: int = 0

    def unknowns(
        self, initial: Vector, *, scale: float, lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf
    ) -> range:
        """Append a block of unknowns and return its indices."""
        block = range(self.size, self.size + initial.size)
        self._initial.append(initial)
        self._lower.append(np.full(initial.size, lower, np.float64))
        self._upper.append(np.full(initial.size, upper, np.float64))
        self._scale.append(np.full(initial.size, scale))
        self.size += initial.size
        return block

    def rows_of(self, block: range, matrix: sparse.csr_array | None = None) -> sparse.csr_array:
        """Spread ``matrix`` (K x len(block)), by default the identity, over all unknowns: K x size."""
        entries = sparse.coo_array(sparse.eye_array(len(block)) if matrix is None else matrix)
        return sparse.csr_array(
            (entries.data, (entries.row, entries.col + block.start)), shape=(entries.shape[0], self.size)
        )

    def apply(self, function: ca.Function, blocks: Sequence[sparse.csr_array], numbers: Vector) -> Places:
        """Apply F(z, p) to K places: ``blocks`` has K rows a local variable, ``numbers`` is n_p x K."""
        places = numbers.shape[1]
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
        lower: ArrayLike,
        upper: ArrayLike,
        *,
        scale: ArrayLike,
        linear: sparse.csr_array | None = None,
        places: Places | None = None,
        scatter: sparse.csr_array | None = None,
    ) -> None:
        """Add rows ``lower <= linear w + scatter F <= upper``, each to be divided by its ``scale``.

        ``scatter`` (rows x values of ``places``) is the identity by default.
        """
        if scatter is None and places is not None:
            scatter = sparse.csr_array(sparse.eye_array(places.values))
        part = linear if linear is not None else scatter
        assert part is not None
        count = part.shape[0]
        if count == 0:
            return
        lowers, uppers, scales = (
            np.broadcast_to(np.asarray(x, float), (count,)) for x in (lower, upper, scale)
        )
        matrix = sparse.csr_array((count, self.size)) if linear is None else sparse.csr_array(linear)
        self._rows.append((matrix, lowers, uppers, scales))
        if places is not None and scatter is not None:
            self._functions[places.index].scatter.append((self.row_count, sparse.csc_array(scatter)))
        self.row_count += count

    def hold(self, rows: sparse.csr_array, lower: Vector, upper: Vector, *, scale: float) -> None:
        """Hold ``rows`` w within bounds: through bounds of unknowns where a row is a single unknown."""
        wanted = np.isfinite(lower) | np.isfinite(upper)
        rows, lower, upper = sparse.csr_array(rows[wanted]), lower[wanted], upper[wanted]
        rows.eliminate_zeros()
        single = np.diff(rows.indptr) == 1
        entries = rows[single]
        unknown_lower, unknown_upper = np.concatenate(self._lower), np.concatenate(self._upper)
        ends = np.sort([lower[single] / entries.data, upper[single] / entries.data], axis=0)
        np.maximum.at(unknown_lower, entries.indices, ends[0])
        np.minimum.at(unknown_upper, entries.indices, ends[1])
        self._lower, self._upper = [unknown_lower], [unknown_upper]
        self.constrain(lower[~single], upper[~single], scale=scale, linear=rows[~single])

    def program(self, objective_scale: float) -> NonlinearProgram:
        """The finished program, in scaled unknowns, rows and objective, and what undoes the scaling."""
        linear, lowers, uppers, scales = zip(*self._rows, strict=True)
        lower, upper = np.concatenate(self._lower), np.concatenate(self._upper)
        scale = np.concatenate(self._scale)
        program = NonlinearProgram(
            initial=np.clip(np.concatenate(self._initial), lower, upper),
            lower=lower,
            upper=upper,
            linear=sparse.csr_array(sparse.vstack(linear, format="csr")),
            linear_cost=np.zeros(self.size),
            constraint_lower=np.concatenate(lowers),
            constraint_upper=np.concatenate(uppers),
            groups=tuple(self._finish(item) for item in self._functions),
        )
        return program.scaled(scale, 1.0 / np.concatenate(scales), 1.0 / objective_scale)

    @property
    def scale(self) -> Vector:
        """What a scaled unknown is multiplied by to give the unknown."""
        return np.concatenate(self._scale)

    def adjoint(self, places: Places, scaled_multipliers: Vector) -> Vector:
        """B' lambda for the values of ``places``, with the multipliers of the rows before their scaling."""
        multipliers = scaled_multipliers / np.concatenate([scales for *_, scales in self._rows])
        values = np.zeros(places.values)
        for start, matrix in self._functions[places.index].scatter:
            values += matrix.T @ multipliers[start : start + matrix.shape[0]]
        return values

    def _finish(self, item: _Function) -> PlaceFunction:
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
        return PlaceFunction(item.function, item.gather, item.numbers, sparse.csc_array(scatter), item.cost)
