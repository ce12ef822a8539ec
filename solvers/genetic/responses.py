"""Controls and chained states at dyadic points as tables by which the coefficients are multiplied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from solvers.genetic.genome import Genome
from solvers.problem import OptimalControlProblem

Vector = NDArray[np.float64]
Rates = Mapping[str, Mapping[str, float]]
"""Chained state -> the factors of its rate by name, that of "" the constant; in an order to be followed."""

# Levels by which integrals of integrals are tabulated more finely than they are used.
_FINER = 4


@dataclass(frozen=True)
class Response:
    """A quantity at K points: ``constant`` (K,) plus coefficients[``genes``] @ ``table`` (genes, K).

    ``total``: the number of all coefficients.
    """

    constant: Vector
    table: Vector
    genes: slice
    total: int


@dataclass(frozen=True)
class Stack:
    """Several quantities that depend on equally many coefficients, to be had by one product.

    ``tables`` (R, K, genes), ``constants`` (R, K, 1); ``genes`` (R, genes): the indices of the coefficients.
    """

    tables: Vector
    constants: Vector
    genes: NDArray[np.intp]

    @property
    def count(self) -> int:
        """R, the number of quantities."""
        return int(self.genes.shape[0])

    @cached_property
    def _moves(self) -> bool:
        """Whether a constant part is not zero."""
        return bool(self.constants.any())

    def fill(self, coefficients: Vector, values: Vector) -> None:
        """Write the quantities of coefficients (P, m N) into ``values`` (R, K, P)."""
        np.matmul(self.tables, coefficients.T[self.genes], out=values)
        if self._moves:
            values += self.constants


def stacked(responses: Sequence[Response]) -> list[Stack]:
    """The same responses in the same order, neighbours of equal widths together."""
    stacks = []
    for _, group in groupby(responses, key=lambda response: response.table.shape[0]):
        alike = list(group)
        tables = np.array([response.table.T for response in alike])
        constants = np.array([response.constant for response in alike])[:, :, None]
        genes = np.array([np.arange(response.genes.start, response.genes.stop) for response in alike])
        stacks.append(Stack(tables, constants, genes))
    return stacks


@dataclass(frozen=True)
class _Rows:
    """A quantity on fine points, and its slope by tau: rows of the constant part and of each coefficient."""

    values: Vector
    slopes: Vector

    def integral(self, width: float) -> Vector:
        """The integral from the first point on, (rows, K): trapezoids corrected by slopes at their ends."""
        values, slopes = self.values, self.slopes
        cells = width / 2 * (values[:, 1:] + values[:, :-1]) + width**2 / 12 * (
            slopes[:, :-1] - slopes[:, 1:]
        )
        return np.hstack([np.zeros((values.shape[0], 1)), np.cumsum(cells, axis=1)])


def tabulate(problem: OptimalControlProblem, genome: Genome, rates: Rates, level: int) -> dict[str, Response]:
    """Responses of time, controls and chained states on the points of ``level``, by name.

    Controls are the slopes of the parabolas through their integrals: for quadrature, not for looking at.
    """
    nested = any(name in rates for factors in rates.values() for name in factors)
    finer = _FINER if nested else 0
    basis, m = genome.basis, len(problem.controls)
    individual = genome.resting
    t0, duration = float(individual.t0[0]), float(individual.tf[0] - individual.t0[0])
    points = basis.points(level + finer)
    values, integrals = (
        _by_control(table, m) for table in (basis.values(level + finer), basis.integrals(level + finer))
    )
    rows: dict[str, _Rows] = {}
    starts = dict(zip(problem.states, individual.initial[:, 0], strict=True))
    for name, factors in rates.items():
        total, slopes = (np.zeros((1 + m * basis.size, points.size)) for _ in range(2))
        for other, factor in factors.items():
            if other == "":
                total[0] += factor * points
                slopes[0] += factor
            elif other in rows:
                total += factor * rows[other].integral(points[1])
                slopes += factor * rows[other].values
            else:
                j = problem.controls.index(other)
                total[1:] += factor * integrals[j]
                slopes[1:] += factor * values[j]
        total *= duration
        total[0] += starts[name]
        rows[name] = _Rows(total, duration * slopes)
    step = 1 << finer
    found = {name: _response(item.values[:, ::step]) for name, item in rows.items()}
    for name, table in zip(problem.controls, integrals, strict=True):
        slopes = parabola_slopes(table[:, ::step])
        found[name] = _response(np.vstack([np.zeros(slopes.shape[1]), slopes]))
    for name, constant in (("t", t0 + duration * points[::step]), ("tau", points[::step])):
        found[name] = Response(constant, np.zeros((0, constant.size)), slice(0, 0), m * basis.size)
    return found


def end_responses(responses: Mapping[str, Response], names: Sequence[str]) -> tuple[Vector, Vector]:
    """Matrix (names, coefficients) and constants (names,): the last values by the coefficients."""
    matrix = np.zeros((len(names), next(iter(responses.values())).total))
    for row, name in zip(matrix, names, strict=True):
        row[responses[name].genes] = responses[name].table[:, -1]
    return matrix, np.array([responses[name].constant[-1] for name in names])


def parabola_slopes(values: Vector) -> Vector:
    """Slopes by tau of the parabolas through three values each, (rows, K) at equal steps over [0, 1], K odd.

    Where two parabolas meet: the mean of both slopes.
    """
    width = 1.0 / (values.shape[1] - 1)
    left, middle, right = values[:, :-2:2], values[:, 1::2], values[:, 2::2]
    slopes = np.zeros_like(values)
    slopes[:, 1::2] = (right - left) / (2 * width)
    slopes[:, :-2:2] += (4 * middle - 3 * left - right) / (2 * width)
    slopes[:, 2::2] += (left - 4 * middle + 3 * right) / (2 * width)
    slopes[:, 2:-2:2] /= 2
    return slopes


def _by_control(table: Vector, controls: int) -> list[Vector]:
    """The table of the basis (N, K) as rows of all coefficients (m N, K), for each control."""
    size = table.shape[0]
    every = []
    for j in range(controls):
        every.append(np.zeros((controls * size, table.shape[1])))
        every[-1][j * size : (j + 1) * size] = table
    return every


def _response(rows: Vector) -> Response:
    """Only those coefficients that matter."""
    used = np.flatnonzero(rows[1:].any(axis=1))
    genes = slice(int(used[0]), int(used[-1]) + 1) if used.size else slice(0, 0)
    return Response(np.array(rows[0]), np.ascontiguousarray(rows[1:][genes]), genes, rows.shape[0] - 1)
