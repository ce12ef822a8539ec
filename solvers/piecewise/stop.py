"""When a mission ends before its last segment: an expression of the tracked state comes within bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.expressions import Expression, parse
from solvers.problem import OptimalControlProblem
from solvers.spec import Interval, PiecewiseMethod, bound_interval

Vector = NDArray[np.float64]


@dataclass
class StopWatch:
    """Watches an expression in ``<state>_f``, parameters and ``tf``; without one it never stops anything.

    Where it asks for averages, these are means over a segment, taken at its middle and linear in between.
    """

    states: tuple[str, ...]
    parameters: Mapping[str, float]
    expression: Expression | None = None
    interval: Interval = (-np.inf, np.inf)
    average: bool = False
    _before: tuple[float, float] | None = field(default=None, init=False)

    @classmethod
    def of(cls, problem: OptimalControlProblem, method: PiecewiseMethod) -> StopWatch:
        """The stop of a document."""
        stop = method.stop
        if stop is None:
            return cls(problem.states, problem.parameters)
        interval = bound_interval(stop.bounds, problem.parameters)
        return cls(problem.states, problem.parameters, parse(stop.expression), interval, bool(stop.average))

    def met(self, times: Vector, seen: Vector) -> float | None:
        """The first instant of a segment at which the expression is within its bounds; None if never.

        ``times`` (K,), ``seen`` (n, K) the problem's states. Segments are shown in turn.
        """
        if self.expression is None:
            return None
        if self.average:
            span = times[-1] - times[0]
            seen = (np.trapezoid(seen, times, axis=1) / span)[:, None]
            times = np.array([(times[0] + times[-1]) / 2.0])
        values = self._outside(seen, times)
        if self._before is not None and self.average:
            times, values = np.append(self._before[0], times), np.append(self._before[1], values)
        self._before = float(times[-1]), float(values[-1])
        inside = np.flatnonzero(values <= 0.0)
        if not inside.size:
            return None
        first = int(inside[0])
        if first == 0:
            return float(times[0])
        part = values[first - 1] / (values[first - 1] - values[first])
        return float(times[first - 1] + part * (times[first] - times[first - 1]))

    def _outside(self, seen: Vector, times: Vector) -> Vector:
        """How far the expression is outside its bounds; negative inside."""
        assert self.expression is not None
        scope = {**self.parameters, "tf": times} | {
            f"{name}_f": row for name, row in zip(self.states, seen, strict=True)
        }
        with np.errstate(all="ignore"):
            value = np.broadcast_to(self.expression.evaluate(scope, NUMPY.functions), times.shape)
        lower, upper = self.interval
        return np.asarray(np.maximum(lower - value, value - upper), np.float64)
