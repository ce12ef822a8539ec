"""When a mission ends before its last segment: a boundary constraint is met on the way."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.expressions import Expression, parse
from solvers.problem import End, OptimalControlProblem
from solvers.spec import Interval, PiecewiseMethod, bound_interval

Vector = NDArray[np.float64]


@dataclass
class StopWatch:
    """Watches a boundary constraint with its end at every instant; without one it never stops anything.

    Where it asks for averages, the end is the mean over a segment, taken at its middle and linear in between.
    """

    problem: OptimalControlProblem
    expression: Expression | None = None
    interval: Interval = (-np.inf, np.inf)
    average: bool = False
    _start: End | None = field(default=None, init=False)
    _before: tuple[float, float] | None = field(default=None, init=False)

    @classmethod
    def of(cls, problem: OptimalControlProblem, method: PiecewiseMethod) -> StopWatch:
        """The stop of a document."""
        stop = method.stop
        if stop is None:
            return cls(problem)
        interval = bound_interval(stop.bounds, problem.parameters)
        return cls(problem, parse(stop.expression), interval, bool(stop.average))

    def met(self, times: Vector, seen: Vector, controls: Vector) -> float | None:
        """The first instant of a segment at which the expression is within its bounds; None if never.

        ``times`` (K,), ``seen`` (n, K) the problem's states, ``controls`` (m, K). Segments are shown in turn.
        """
        if self.expression is None:
            return None
        begins = self._start is None
        if self._start is None:
            self._start = seen[:, 0], controls[:, 0], float(times[0])
        if self.average:
            span = times[-1] - times[0]
            seen, controls = (
                (np.trapezoid(rows, times, axis=1) / span)[:, None] for rows in (seen, controls)
            )
            times = np.array([(times[0] + times[-1]) / 2.0])
        values = self._outside(self._start, (seen, controls, times))
        if self._before is not None and self.average:
            times, values = np.append(self._before[0], times), np.append(self._before[1], values)
        self._before = float(times[-1]), float(values[-1])
        inside = np.flatnonzero(values <= 0.0)
        if begins and not self.average:
            inside = inside[inside > 0]  # a mission is longer than its start
        if not inside.size:
            return None
        first = int(inside[0])
        if first == 0 or values[first - 1] <= 0.0:
            return float(times[first])
        part = values[first - 1] / (values[first - 1] - values[first])
        return float(times[first - 1] + part * (times[first] - times[first - 1]))

    def _outside(self, start: End, ends: End) -> Vector:
        """How far the expression is outside its bounds for each of these ends; negative inside."""
        assert self.expression is not None
        with np.errstate(all="ignore"):
            scope = self.problem.ends_scope(
                start, ends, self.problem.parameters, NUMPY, wanted=self.expression.names
            )
            value = np.broadcast_to(self.expression.evaluate(scope, NUMPY.functions), ends[2].shape)
        lower, upper = self.interval
        return np.asarray(np.maximum(lower - value, value - upper), np.float64)
