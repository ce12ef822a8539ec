"""The equations of a problem over arrays, laid out once for who asks for rates thousands of times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.arrays.graph import Graph, GraphBackend, Symbol
from solvers.arrays.kernel import Kernels, NumpyKernel
from solvers.backends import NUMPY
from solvers.expressions import Expression
from solvers.problem import OptimalControlProblem, Parameters

Vector = NDArray[np.float64]


class Rates:
    """Rates of the states, and integrands beside them, at K places at once; with ``parameters`` folded in.

    Mass matrices are solved with numbers, which shows where a pivot is needed; a graph could not know.
    """

    def __init__(
        self, problem: OptimalControlProblem, parameters: Parameters, integrands: Sequence[Expression | None]
    ) -> None:
        graph = Graph()
        backend = GraphBackend(graph)
        bodies, states = problem.dynamics.bodies, problem.states
        x, u = ([graph.input(name) for name in names] for names in (states, problem.controls))
        scope = problem.scope(x, u, graph.input("t"), parameters, backend)
        names = [*states, *problem.controls, "t"]
        self._bodies = [len(body.coordinates) for body in bodies]
        self._velocities = [states.index(name) for body in bodies for name in body.velocities]
        equations: list[Any] = []
        for body in bodies:
            mass, loads = body.equations(scope, backend)
            equations += [entry for row in mass for entry in row] + loads
        functions = backend.functions
        equations += [rate.evaluate(scope, functions) for rate in problem.dynamics.first_order.values()]
        self._equations = Kernels(_symbols(graph, equations), names, NumpyKernel)
        # Accelerations are known by now: for the integrands they are numbers like any other.
        found = [name for body in bodies for name in body.accelerations]
        scope.update({name: graph.input(name) for name in found})
        values = [0.0 if item is None else item.evaluate(scope, functions) for item in integrands]
        self._integrands = Kernels(_symbols(graph, values), [*names, *found], NumpyKernel)
        self._size = len(states), len(integrands)

    def __call__(self, states: Vector, controls: Vector, times: Vector) -> Vector:
        """Rates and integrands, (n + i, K), of states (n, K) under controls (m, K) at times (K,)."""
        n, count = self._size[0], times.size
        found = np.empty((sum(self._size), count))
        kernel = self._equations.at(count)
        given, width = kernel.inputs, n + len(controls)
        given[:n], given[n:width], given[width] = states, controls, times
        with np.errstate(all="ignore"):
            kernel.run()
            accelerations, row = [], 0
            for size in self._bodies:
                mass = kernel.outputs[row : row + size * size].reshape(size, size, count)
                row += size * size + size
                accelerations += NUMPY.solve([*mass], [*kernel.outputs[row - size : row]])
            coordinates = len(self._velocities)
            found[:coordinates] = states[self._velocities]
            for target, value in zip(found[coordinates : 2 * coordinates], accelerations, strict=True):
                target[:] = value
            found[2 * coordinates : n] = kernel.outputs[row:]
            last = self._integrands.at(count)
            last.inputs[: len(given)] = given
            last.inputs[len(given) :] = found[coordinates : 2 * coordinates]
            last.run()
            found[n:] = last.outputs
        return found


def _symbols(graph: Graph, values: Sequence[Any]) -> list[Symbol]:
    return [graph.symbol(value) for value in values]
