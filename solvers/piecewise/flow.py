"""Flying a model along a control that is linear piece by piece: Runge-Kutta with the whole step compiled.

The evaluations of a step (twelve of DOP853, six of RK45) and its error estimate are one CasADi function,
called through buffers; the choice of the step stays outside.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Springer 1993, II.5 and II.10;
coefficients and error estimates as in scipy.integrate.RK45 and DOP853.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853, RK45

from solvers.errors import OndeletteError

Vector = NDArray[np.float64]

Scheme = type[DOP853] | type[RK45]

_SAFETY, _LEAST, _MOST = 0.9, 0.2, 5.0
_SMALLEST = 1e-6  # the least size of a state
_SHORTEST = 1e-12  # of a piece: below it the rate is not finite, or the state runs away


class RunawayError(OndeletteError):
    """The state has no finite rate, or runs away; ``time`` is where."""

    def __init__(self, time: float) -> None:
        self.time = time
        super().__init__(f"the state runs away at t = {time:.6g}")


class Flow:
    """x' = rate(x, u, t, held) with (n,) states, m controls and numbers that are held over a piece.

    The error of a step stays below ``rtol`` of the size of each of the first ``watched`` states (all of them
    without it): the largest that it has had, or changes by over a piece. Others, such as a running cost, ride
    along. ``scheme``: DOP853 of order 8, or RK45 of order 5, cheaper where the tolerance is loose.
    """

    def __init__(
        self, rate: ca.Function, rtol: float, watched: int | None = None, scheme: Scheme = DOP853
    ) -> None:
        size = int(rate.size1_in(0))
        self._rtol = rtol
        self._exponent = -1.0 / (scheme.error_estimator_order + 1)
        self._rate = _Buffered(rate)
        self._step = _Buffered(_step_function(rate, size if watched is None else watched, scheme))
        self._sizes = np.full(size, _SMALLEST)
        self._length = np.inf

    def fly(
        self, x: Vector, t0: float, t1: float, u0: Vector, u1: Vector, held: Vector | None = None
    ) -> Vector:
        """The state at t1 from ``x`` at t0, with the control going straight from u0 to u1.

        Raises RunawayError.
        """
        kept = np.zeros(0) if held is None else held
        span = t1 - t0
        time, state, length = t0, x, min(self._length, span)
        slope = self._rate(x, u0, t0, kept)[0]
        self._sizes = np.fmax(self._sizes, np.fmax(np.abs(x), np.abs(slope) * span))
        watch = 1.0 / (self._rtol * self._sizes)
        while time < t1:
            last = time + length * (1.0 + 1e-9) >= t1
            length = t1 - time if last else length
            new, new_slope, error = self._step(state, slope, time, length, t0, span, u0, u1, kept, watch)
            if not error[0] <= 1.0:
                factor = _SAFETY * error[0] ** self._exponent if np.isfinite(error[0]) else _LEAST
                length *= max(_LEAST, factor)
                if length < _SHORTEST * span:
                    raise RunawayError(time)
                continue
            time = t1 if last else time + length
            state, slope = new, new_slope
            growth = _MOST if error[0] == 0.0 else min(_MOST, _SAFETY * error[0] ** self._exponent)
            if not last or growth < 1.0:
                length *= growth
            self._length = length * (growth if last else 1.0)
        return state


class _Buffered:
    """A CasADi function on NumPy arrays, without the copies of its usual call."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function  # the buffer does not keep it alive
        self._buffer, self._evaluate = function.buffer()
        # A buffer may not be empty.
        kept = [np.zeros(max(1, function.nnz_in(i))) for i in range(function.n_in())]
        self._inputs = [values[: function.nnz_in(i)] for i, values in enumerate(kept)]
        self._outputs = [np.zeros(max(1, function.nnz_out(i))) for i in range(function.n_out())]
        for index, values in enumerate(kept):
            self._buffer.set_arg(index, memoryview(values))  # type: ignore[call-arg,arg-type]
        for index, values in enumerate(self._outputs):
            self._buffer.set_res(index, memoryview(values))  # type: ignore[call-arg,arg-type]

    def __call__(self, *values: Vector | float) -> list[Vector]:
        for place, value in zip(self._inputs, values, strict=True):
            place[:] = value
        self._evaluate()
        return [output.copy() for output in self._outputs]


def _step_function(rate: ca.Function, watched: int, scheme: Scheme) -> ca.Function:
    """(x, x', t, h, start and span of the piece, u0, u1, held, 1/tolerance) -> x, x', error after a step."""
    size, controls = rate.size1_in(0), rate.size1_in(1)
    x, slope = ca.MX.sym("x", size), ca.MX.sym("slope", size)
    t, h, start, span = (ca.MX.sym(name) for name in ("t", "h", "start", "span"))
    u0, u1 = ca.MX.sym("u0", controls), ca.MX.sym("u1", controls)
    held, watch = ca.MX.sym("held", rate.size1_in(3)), ca.MX.sym("watch", size)

    def at(state: ca.MX, part: float) -> ca.MX:
        time = t + part * h
        return rate(state, u0 + (time - start) / span * (u1 - u0), time, held)

    def combined(weights: Vector, slopes: list[ca.MX]) -> ca.MX:
        used = [float(weight) * one for weight, one in zip(weights, slopes, strict=False) if weight != 0.0]
        return sum(used[1:], start=used[0])

    slopes = [slope]
    for row, part in zip(scheme.A[1:], scheme.C[1:], strict=True):
        slopes.append(at(x + h * combined(row[: len(slopes)], slopes), float(part)))
    new = x + h * combined(scheme.B, slopes)
    slopes.append(at(new, 1.0))

    def off(weights: Vector) -> ca.MX:
        return ca.sumsqr((combined(weights, slopes) * watch)[:watched])

    if scheme is DOP853:
        fifth, third = off(DOP853.E5), off(DOP853.E3)
        error = ca.fabs(h) * fifth / ca.sqrt((fifth + 0.01 * third + 1e-300) * watched)
    else:
        error = ca.fabs(h) * ca.sqrt(off(scheme.E) / watched)
    inputs = [x, slope, t, h, start, span, u0, u1, held, watch]
    return ca.Function("step", inputs, [new, slopes[-1], error])
