"""Time derivatives of a limit along the model, up to the one that a control decides: the order of the limit.

On an arc that follows S(x, t) = 0 of order q, S^(q)(x, u, t) = 0, and S = ... = S^(q-1) = 0 where it begins:
Bryson, Denham, Dreyfus, "Optimal programming problems with inequality constraints I", AIAA Journal 1(11),
1963.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from solvers.limits import Limit
from solvers.problem import OptimalControlProblem
from solvers.symbolic import CASADI
from solvers.transcription.nodes import NodeSymbols

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class LimitRates:
    """``values``: S, S', ..., S^(q) as functions (x, u, t, parameters) of columns of SX.

    ``controls``: indices of the controls that decide S^(q).
    """

    values: tuple[ca.Function, ...]
    controls: tuple[int, ...]

    @property
    def order(self) -> int:
        """The order q."""
        return len(self.values) - 1

    def at(self, symbols: NodeSymbols, orders: Sequence[int]) -> list[Any]:
        """The derivatives of these orders in the symbols of a node."""
        columns = (symbols.x, symbols.u, [symbols.t], symbols.parameters.values())
        return [self.values[order](*[ca.vertcat(*column) for column in columns]) for order in orders]

    def along(
        self, parameters: Mapping[str, float], states: Vector, controls: Vector, times: Vector
    ) -> Vector:
        """The derivatives of orders 0 to q at K instants, (q + 1, K)."""
        columns = np.tile(np.array([[value] for value in parameters.values()]), times.size)
        numbers = (states, controls, times[None, :], columns.reshape(-1, times.size))
        return np.vstack([np.broadcast_to(value(*numbers).full(), (1, times.size)) for value in self.values])


def limit_rates(problem: OptimalControlProblem, limit: Limit) -> LimitRates | None:
    """Differentiate the expression of a limit until a control appears; None where none ever does."""
    x, u = ca.SX.sym("x", len(problem.states)), ca.SX.sym("u", len(problem.controls))
    names = [*problem.parameters, *(item.name for item in problem.design)]
    t, p = ca.SX.sym("t"), ca.SX.sym("p", len(names))
    states, controls = ca.vertsplit(x), ca.vertsplit(u)
    parameters = dict(zip(names, ca.vertsplit(p), strict=True))
    rate = ca.vertcat(*[ca.SX(value) for value in problem.rate(states, controls, t, parameters, CASADI)])
    scope = problem.scope(states, controls, t, parameters, CASADI)
    value = ca.SX(limit.expression.evaluate(scope, CASADI.functions))
    values = []
    for order in range(len(problem.states) + 1):
        values.append(ca.Function(f"limit_{order}", [x, u, t, p], [value]))
        slopes = ca.jacobian(value, u)
        deciding = tuple(j for j in range(len(problem.controls)) if slopes[j].nnz())
        if deciding:
            return LimitRates(tuple(values), deciding)
        value = ca.mtimes(ca.jacobian(value, x), rate) + ca.jacobian(value, t)
    return None
