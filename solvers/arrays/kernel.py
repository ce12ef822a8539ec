"""Runs a graph over arrays: NumPy's own functions one after the other, into memory that is there already."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.arrays.graph import OPERATIONS, Graph, Symbol, needed
from solvers.formulation.data_table import DataTable

Vector = NDArray[np.float64]
logger = logging.getLogger(__name__)


class NumpyKernel:
    """Values of a graph at K places at once.

    ``inputs`` (names, K) and ``outputs`` (values, K) are arrays: write the one, :meth:`run`, read the other.
    """

    def __init__(self, outputs: Sequence[Symbol], names: Sequence[str], places: int) -> None:
        self.inputs: Vector = np.zeros((len(names), places))
        self.outputs: Vector = np.zeros((len(outputs), places))
        inputs = dict(zip(names, self.inputs, strict=True))
        self._steps = _steps(outputs[0].graph, outputs, inputs, self.outputs) if outputs else []

    def run(self) -> None:
        """Evaluate everything; what has no value is NaN or infinite, without a warning to be had."""
        for operation, arguments in self._steps:
            operation(*arguments)


_Step = tuple[Callable[..., Any], tuple[Any, ...]]
# NumPy wants the output of these by name, which takes longer.
_NAMED_OUTPUT = frozenset({"min", "max"})


def _steps(
    graph: Graph, outputs: Sequence[Symbol], inputs: Mapping[str, Vector], results: Vector
) -> list[_Step]:
    """Calls with their arrays; an array is used again as soon as nobody needs its value."""
    order = needed(graph, outputs)
    last = {operand: place for place in order for operand in graph.nodes[place].operands}
    wanted = {symbol.place: results[row] for row, symbol in reversed(list(enumerate(outputs)))}
    held: dict[int, Any] = {}
    free: list[Vector] = []
    steps: list[_Step] = []
    for place in order:
        node = graph.nodes[place]
        if node.operation == "constant":
            held[place] = np.array(node.value)  # passes faster than a number of Python's
        elif node.operation == "input":
            held[place] = inputs[node.name]
        else:
            operands = tuple(held[operand] for operand in node.operands)
            for operand in set(node.operands):
                if last[operand] == place and operand not in wanted and graph.nodes[operand].operands:
                    free.append(held[operand])
            target = wanted.get(place)
            if target is None:
                target = free.pop() if free else np.empty(results.shape[1])
            if node.table is not None:
                steps.append((partial(_look_up, node.table), (*operands, target)))
                held[place] = target
                continue
            operation = OPERATIONS[node.operation]
            if node.operation in _NAMED_OUTPUT:
                steps.append((partial(operation, out=target), operands))
            else:
                steps.append((operation, (*operands, target)))
            held[place] = target
    # Inputs and constants, and a value that stands twice among the outputs.
    copies: list[_Step] = [
        (np.copyto, (results[row], held[symbol.place]))
        for row, symbol in enumerate(outputs)
        if not np.shares_memory(results[row], held[symbol.place])
    ]
    return steps + copies


def _look_up(table: DataTable, arguments: Vector, target: Vector) -> None:
    target[:] = table(arguments)


class Kernel(Protocol):
    """What runs a graph: write the inputs, run, read the outputs."""

    inputs: Vector
    outputs: Vector

    def run(self) -> None:
        """Evaluate everything."""
        ...


MakeKernel = Callable[[Sequence[Symbol], Sequence[str], int], Kernel]


@cache
def fastest_kernel() -> MakeKernel:
    """The compiled kernel where numba is installed, else NumPy's."""
    if find_spec("numba") is None:
        return NumpyKernel
    try:
        from solvers.arrays.compiled import CompiledKernel
    except (
        ImportError,
        RuntimeError,
    ) as error:  # it does not fit, or finds no place to keep what it compiles
        logger.warning("numba cannot be used (%s): populations are evaluated by NumPy, more slowly", error)
        return NumpyKernel
    return CompiledKernel


class Kernels:
    """Kernels of the same values for several numbers of places, made where they are first wanted.

    ``make``: by default the fastest there is.
    """

    def __init__(
        self, outputs: Sequence[Symbol], names: Sequence[str], make: MakeKernel | None = None
    ) -> None:
        self._outputs, self._names = list(outputs), list(names)
        self._make = make or fastest_kernel()
        if any(node.table is not None for symbol in outputs[:1] for node in symbol.graph.nodes):
            self._make = NumpyKernel  # the compiled loop knows no tables
        self._made: dict[int, Kernel] = {}

    def at(self, places: int) -> Kernel:
        """The kernel for so many places."""
        if places not in self._made:
            make = self._make if self._outputs else NumpyKernel
            self._made[places] = make(self._outputs, self._names, places)
        return self._made[places]
