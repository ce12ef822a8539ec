"""Runge-Kutta steps of order 8 for a whole population, side by side, with one length for all.

The length is that which the worst of them needs; a flight that cannot be followed any further is given up,
so that it does not hold up the others.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Springer 1993, II.5 and II.10;
coefficients and error estimate as in scipy.integrate.DOP853.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

Vector = NDArray[np.float64]

NODES: Vector = np.asarray(DOP853.C[: DOP853.n_stages], np.float64)
"""The parts of a step at which rates are wanted."""
_STAGES = DOP853.n_stages
_SAFETY, _LEAST, _MOST = 0.9, 0.2, 5.0
_EXPONENT = -1.0 / 8.0
_SHORTEST = 1e-9  # of the way that is left to the next stop

Rate = Callable[[int, Vector, Vector], None]
"""(stage, states (n, P), rates (n, P) to be filled): of the step that was begun last."""
Begin = Callable[[float, float], None]
"""Told where a step is tried, before its rates are asked for."""


class Population:
    """P states (n, P) that move together; ``lost`` (P,) says which of them could not be followed.

    The error of a step stays below ``rtol`` of ``sizes`` (n,), or of the state itself where that is larger.
    """

    def __init__(
        self,
        states: Vector,
        sizes: Vector,
        rtol: float,
        begin: Begin,
        rate: Rate,
        lost: NDArray[np.bool_] | None = None,
    ) -> None:
        self.states = np.array(states, np.float64)
        self.lost = np.zeros(states.shape[1], bool) if lost is None else lost.copy()
        self.steps = 0
        self._begin, self._rate = begin, rate
        self._rtol, self._sizes = rtol, sizes[:, None]
        self._length = np.inf
        self._rates = np.empty((_STAGES, *states.shape))
        self._trial = np.empty(states.shape)

    def advance(self, start: float, stop: float) -> None:
        """Move from one time to another, between which rates are smooth."""
        time = start
        shortest = _SHORTEST * (stop - start)
        length = min(self._length, stop - start)
        while time < stop:
            # No crumb is left for a step of its own.
            end = stop if time + 1.01 * length >= stop else time + length
            errors = self._try(time, end - time)
            worst = float(np.max(errors, where=~self.lost, initial=0.0))
            if worst <= 1.0:
                self.states, self._trial = self._trial, self.states
                longer = (end - time) * (min(_MOST, _SAFETY * worst**_EXPONENT) if worst > 0.0 else _MOST)
                # A step that was cut short at a stop says nothing against the longer one that was meant.
                cut = end == stop and np.isfinite(self._length)
                self._length = max(longer, self._length) if cut else longer
                time, length = end, self._length
            elif end - time <= shortest:
                self._give_up(errors > 1.0)
            else:
                length = self._length = (end - time) * max(_LEAST, _SAFETY * worst**_EXPONENT)

    def _try(self, time: float, length: float) -> Vector:
        """Put the states after a step into the trial; return errors (P,) as parts of what is allowed."""
        self.steps += 1
        self._begin(time, length)
        rates, trial, states = self._rates, self._trial, self.states
        flat = rates.reshape(_STAGES, -1)
        with np.errstate(all="ignore"):
            for stage in range(_STAGES):
                trial[:] = states
                if stage:
                    trial += (length * DOP853.A[stage, :stage] @ flat[:stage]).reshape(states.shape)
                self._rate(stage, trial, rates[stage])
            np.add(states, (length * DOP853.B @ flat).reshape(states.shape), out=trial)
            allowed = self._rtol * np.maximum(self._sizes, np.maximum(np.abs(states), np.abs(trial)))
            fifth, third = (
                np.sum(np.square((weights[:_STAGES] @ flat).reshape(states.shape) / allowed), axis=0)
                for weights in (DOP853.E5, DOP853.E3)
            )
            size = np.sqrt((fifth + 0.01 * third) * states.shape[0])
            errors = np.where(fifth > 0.0, length * fifth / size, 0.0)
        return np.where(np.isfinite(errors), errors, np.inf)

    def _give_up(self, runaway: NDArray[np.bool_]) -> None:
        """Let those that cannot be followed stand where a flight that can be is."""
        self.lost |= runaway
        alive = np.flatnonzero(~self.lost)
        if alive.size:
            self.states[:, self.lost] = self.states[:, alive[:1]]
