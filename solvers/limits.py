"""The limits of a problem: each side of a state bound or path constraint that a trajectory may rest on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.expressions import Expression, named
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Limit:
    """``expression`` <= ``level`` where ``upper``, >= otherwise.

    ``state`` is the index of the state that the bound is of, ``path`` that of the path constraint; one of
    them is None. ``pointer`` is the place in the document.
    """

    pointer: str
    expression: Expression = field(compare=False)
    level: float
    upper: bool
    state: int | None = None
    path: int | None = None

    def of(self, problem: OptimalControlProblem) -> Limit:
        """The same limit of a problem that differs in numbers only."""
        if self.path is not None:
            return replace(self, level=problem.path[self.path].interval[self.upper])
        assert self.state is not None
        return replace(self, level=problem.state_bounds[self.state][self.upper])

    def room(self, problem: OptimalControlProblem, trajectory: Trajectory, tau: Vector) -> Vector:
        """How far the trajectory stays inside the limit at K normalised times; negative outside."""
        x, u, t = trajectory.states_at(tau), trajectory.controls_at(tau), trajectory.time(tau)
        with np.errstate(all="ignore"):
            values = self.expression.evaluate(
                problem.scope(x, u, t, problem.parameters_of(trajectory), NUMPY), NUMPY.functions
            )
        sign = 1.0 if self.upper else -1.0
        return np.asarray(np.broadcast_to(sign * (self.level - values), tau.shape), np.float64)


def limits_of(problem: OptimalControlProblem) -> list[Limit]:
    """Every finite side of the state bounds and of the path constraints that are no equations."""
    bounds = [
        (problem.bound_pointer(name), named(name), interval, {"state": index})
        for index, (name, interval) in enumerate(zip(problem.states, problem.state_bounds, strict=True))
    ]
    bounds += [
        (item.pointer, item.expression, item.interval, {"path": index})
        for index, item in enumerate(problem.path)
    ]
    return [
        Limit(pointer, expression, level, upper, **index)
        for pointer, expression, interval, index in bounds
        for level, upper in zip(interval, (False, True), strict=True)
        if np.isfinite(level) and interval[0] < interval[1]
    ]
