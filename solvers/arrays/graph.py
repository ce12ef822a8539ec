"""Computation graphs: the third thing that expressions are evaluated over, besides arrays and CasADi.

A problem evaluated over :class:`Symbol` leaves a graph in which equal subexpressions are one node and
constants are folded. It tells which inputs a value depends on and how (:mod:`solvers.arrays.structure`), and
a kernel runs it over arrays without looking anything up again (:mod:`solvers.arrays.kernel`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from solvers.expressions import LOOKUP, NUMPY_FUNCTIONS
from solvers.formulation.data_table import DataTable

Operands = tuple[int, ...]

_ARITHMETIC: Mapping[str, Callable[..., Any]] = {
    "add": np.add,
    "subtract": np.subtract,
    "multiply": np.multiply,
    "divide": np.divide,
    "negative": np.negative,
    "power": np.power,
}
OPERATIONS: Mapping[str, Callable[..., Any]] = {**_ARITHMETIC, **NUMPY_FUNCTIONS}
"""Every operation of a graph by name, as the NumPy function that does it."""

COMMUTATIVE = frozenset({"add", "multiply", "min", "max"})
LARGEST_CHAIN = 4
"""Integer powers up to this one are products."""


@dataclass(frozen=True, slots=True)
class Node:
    """An operation on earlier nodes; an input by ``name``; or a constant: neither operands nor name.

    A lookup (one operand) has its ``table``.
    """

    operation: str
    operands: Operands = ()
    name: str = ""
    value: float = 0.0
    table: DataTable | None = None

    def __call__(self, *operands: Any) -> Any:
        """The value of an operation for values of its operands."""
        return OPERATIONS[self.operation](*operands) if self.table is None else self.table(*operands)


@dataclass
class Graph:
    """Nodes in an order in which each stands behind its operands."""

    nodes: list[Node] = field(default_factory=list)
    _places: dict[Node, int] = field(default_factory=dict)

    def input(self, name: str) -> Symbol:
        """The input of this name."""
        return self._symbol(Node("input", name=name))

    def constant(self, value: float) -> Symbol:
        """A number."""
        return self._symbol(Node("constant", value=float(value)))

    def symbol(self, value: Any) -> Symbol:
        """A symbol as it is; a number as a constant of this graph."""
        return value if isinstance(value, Symbol) else self.constant(value)

    def apply(self, operation: str, *operands: Symbol) -> Symbol:
        """The value of an operation, simplified where a constant makes it trivial."""
        values = [self.nodes[operand.place] for operand in operands]
        if all(value.operation == "constant" for value in values):
            with np.errstate(all="ignore"):
                return self.constant(OPERATIONS[operation](*[np.float64(value.value) for value in values]))
        simpler = self._simplified(operation, operands)
        if simpler is not None:
            return simpler
        places = tuple(operand.place for operand in operands)
        if operation in COMMUTATIVE:
            places = tuple(sorted(places))
        return self._symbol(Node(operation, places))

    def look_up(self, table: DataTable, argument: Symbol) -> Symbol:
        """The value that a data table gives."""
        node = self.nodes[argument.place]
        if node.operation == "constant":
            return self.constant(float(table(node.value)))
        return self._symbol(Node(LOOKUP, (argument.place,), table=table))

    def is_constant(self, symbol: Symbol, value: float) -> bool:
        """Whether a symbol is this number."""
        node = self.nodes[symbol.place]
        return node.operation == "constant" and node.value == value

    def _opposite(self, symbol: Symbol) -> Symbol | None:
        """What a symbol is the negative of; None where it is not written as one."""
        node = self.nodes[symbol.place]
        return Symbol(self, node.operands[0]) if node.operation == "negative" else None

    def _simplified(self, operation: str, operands: Sequence[Symbol]) -> Symbol | None:
        first, last = operands[0], operands[-1]
        match operation:
            case "add":
                for one, other in ((first, last), (last, first)):
                    if self.is_constant(one, 0.0):
                        return other
                    if self._opposite(one) is not None:
                        return self.apply("subtract", other, -one)
            case "subtract" if self.is_constant(last, 0.0):
                return first
            case "subtract" if self._opposite(last) is not None:
                return self.apply("add", first, -last)
            case "subtract" if self.is_constant(first, 0.0):
                return -last
            case "multiply":
                for one, other in ((first, last), (last, first)):
                    if self.is_constant(one, 0.0):
                        return one
                    if self.is_constant(one, 1.0):
                        return other
                    if self.is_constant(one, -1.0) or self._opposite(one) is not None:
                        return -(other * -one)
            case "divide" if self.is_constant(last, 1.0):
                return first
            case "power":
                return self._product(first, self.nodes[last.place])
        return None

    def _product(self, base: Symbol, exponent: Node) -> Symbol | None:
        """Small integer powers as products, the root of a half."""
        if exponent.operation != "constant":
            return None
        if exponent.value == 0.5:
            return self.apply("sqrt", base)
        if exponent.value not in range(1, LARGEST_CHAIN + 1):
            return None
        product = base
        for _ in range(int(exponent.value) - 1):
            product = product * base
        return product

    def _symbol(self, node: Node) -> Symbol:
        place = self._places.setdefault(node, len(self.nodes))
        if place == len(self.nodes):
            self.nodes.append(node)
        return Symbol(self, place)


@dataclass(frozen=True, slots=True, eq=False)
class Symbol:
    """A node of a graph; arithmetic makes further ones."""

    graph: Graph
    place: int

    def __add__(self, other: Any) -> Symbol:
        return self._with("add", other)

    def __radd__(self, other: Any) -> Symbol:
        return self._with("add", other)

    def __sub__(self, other: Any) -> Symbol:
        return self._with("subtract", other)

    def __rsub__(self, other: Any) -> Symbol:
        return self.graph.apply("subtract", self.graph.symbol(other), self)

    def __mul__(self, other: Any) -> Symbol:
        return self._with("multiply", other)

    def __rmul__(self, other: Any) -> Symbol:
        return self._with("multiply", other)

    def __truediv__(self, other: Any) -> Symbol:
        return self._with("divide", other)

    def __rtruediv__(self, other: Any) -> Symbol:
        return self.graph.apply("divide", self.graph.symbol(other), self)

    def __pow__(self, other: Any) -> Symbol:
        return self._with("power", other)

    def __rpow__(self, other: Any) -> Symbol:
        return self.graph.apply("power", self.graph.symbol(other), self)

    def __neg__(self) -> Symbol:
        opposite = self.graph._opposite(self)
        return self.graph.apply("negative", self) if opposite is None else opposite

    def _with(self, operation: str, other: Any) -> Symbol:
        return self.graph.apply(operation, self, self.graph.symbol(other))


def needed(graph: Graph, outputs: Sequence[Symbol]) -> list[int]:
    """The nodes that these values need, in order."""
    wanted = {symbol.place for symbol in outputs}
    for place in range(len(graph.nodes) - 1, -1, -1):
        if place in wanted:
            wanted.update(graph.nodes[place].operands)
    return sorted(wanted)


@dataclass(frozen=True)
class GraphBackend:
    """Evaluates expressions into one graph; see :class:`solvers.backends.Backend`."""

    graph: Graph

    @property
    def functions(self) -> Mapping[str, Callable[..., Any]]:
        """The functions of the expression language over symbols and numbers."""
        functions: dict[str, Callable[..., Any]] = {name: self._function(name) for name in NUMPY_FUNCTIONS}
        functions[LOOKUP] = lambda table, value: self.graph.look_up(table, self.graph.symbol(value))
        return functions

    def _function(self, name: str) -> Callable[..., Symbol]:
        return lambda *values: self.graph.apply(name, *[self.graph.symbol(value) for value in values])

    def solve(self, matrix: Sequence[Sequence[Any]], right: Sequence[Any]) -> list[Any]:
        """Gaussian elimination; pivots on the diagonal, as for the positive definite matrices of mechanics.

        A pivot that is zero as it stands is exchanged for the next row that has another one.
        """
        graph = self.graph
        rows = [
            [graph.symbol(entry) for entry in (*row, load)] for row, load in zip(matrix, right, strict=True)
        ]
        size = len(rows)
        for k in range(size):
            pivot = next((i for i in range(k, size) if not graph.is_constant(rows[i][k], 0.0)), k)
            rows[k], rows[pivot] = rows[pivot], rows[k]
            for i in range(k + 1, size):
                factor = rows[i][k] / rows[k][k]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
        solution: list[Symbol] = []
        for k in reversed(range(size)):
            load = rows[k][size]
            for entry, value in zip(rows[k][size - 1 : k : -1], solution, strict=True):
                load = load - entry * value
            solution.append(load / rows[k][k])
        return solution[::-1]
