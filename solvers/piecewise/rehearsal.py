"""What the tracker will do, rehearsed: the simple model in flight along a reference.

What no control moves is known beforehand, also halfway between two instants; the driven states are flown.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import RK45

from solvers.piecewise.flow import Flow
from solvers.piecewise.simple import SimpleModel

Vector = NDArray[np.float64]

# The simple model is off by more: a finer flight of it says no more about the plant.
_TOLERANCE = 1e-6


class Rehearsal:
    """Stands for the plant where a tracker is simulated: a `solvers.piecewise.track.Body`."""

    def __init__(self, model: SimpleModel) -> None:
        self._driven, self._outside = list(model.driven), list(model.exogenous)
        self._model = model
        self._flow = Flow(model.rate_between, _TOLERANCE, scheme=RK45)
        self._places: dict[float, int] = {}
        self._numbers = np.zeros((0, 0))

    def begin(self, start: Vector, times: Vector) -> None:
        """A new flight from all states ``start`` (n,), to be seen at ``times`` (K,)."""
        halves = np.empty(2 * times.size - 1)
        halves[::2], halves[1::2] = times, (times[1:] + times[:-1]) / 2
        self._places = {time: 2 * place for place, time in enumerate(times.tolist())}
        self._numbers = self._model.beforehand(start, halves)

    def see(self, x: Vector, t: float) -> Vector:
        """The simple model is what it is."""
        return x

    def fly(self, x: Vector, t0: float, t1: float, u0: Vector, u1: Vector) -> Vector:
        """All states at t1 from ``x`` at t0, one of the times and the next one. Raises RunawayError."""
        place = self._places[t0]
        known = self._numbers[:, place : place + 3]
        state = np.empty_like(x)
        state[self._driven] = self._flow.fly(x[self._driven], t0, t1, u0, u1, known.ravel(order="F"))
        state[self._outside] = known[: len(self._outside), -1]
        return state
