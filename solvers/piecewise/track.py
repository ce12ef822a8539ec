"""Tracking: feedback along a reference segment, clipped at the limits of the actuators.

Between node and middle the control goes straight from u_k to u_(k+1/2), then to the next feed-forward value;
both are corrected by gains times the deviation at the node, and clipped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.errors import OndeletteError
from solvers.piecewise.gains import Gains, Weights, tracking_gains
from solvers.piecewise.reference import Reference
from solvers.piecewise.simple import SimpleModel

Vector = NDArray[np.float64]


class UnseenError(OndeletteError):
    """What is flown cannot be seen: a state of the simple model is not finite."""


class Body(Protocol):
    """What is flown: the plant, or the simple model that stands for it."""

    def see(self, x: Vector, t: float) -> Vector:
        """The states of the simple model, (n,)."""
        ...

    def fly(self, x: Vector, t0: float, t1: float, u0: Vector, u1: Vector) -> Vector:
        """The own states at t1 from ``x`` at t0, with the control going straight from u0 to u1."""
        ...


@dataclass(frozen=True)
class Track:
    """A tracked segment: N pieces of the control, one from node to middle, one from middle to node, in turn.

    ``times`` (N + 1,), ``states`` (N + 1, .) of the body, ``seen`` (n, N + 1) those of the simple model,
    ``before`` and ``after`` (N, m): the control where a piece begins and where it ends.
    """

    times: Vector
    states: Vector
    seen: Vector
    before: Vector
    after: Vector

    @property
    def controls(self) -> Vector:
        """The control at every instant, (m, N + 1); where it jumps, its right side."""
        return np.vstack([self.before, self.after[-1:]]).T


@dataclass(frozen=True)
class Tracker:
    """Follows references with the ``weights`` of the driven states; ``limits`` (m, 2) clip the controls."""

    model: SimpleModel
    weights: Weights
    limits: Vector
    horizon: int | None = None

    def gains(self, reference: Reference) -> Gains:
        """The gains along a reference."""
        count = reference.times.size
        driven = reference.states[list(self.model.driven)]
        slopes = self.model.slopes.map(count)(driven, reference.controls, reference.numbers)
        n, m = driven.shape[0], reference.controls.shape[0]
        a, b = (
            np.asarray(values.full()).reshape(n, count, width).swapaxes(0, 1)
            for values, width in zip(slopes, (n, m), strict=True)
        )
        return tracking_gains(a, b, np.diff(reference.times[::2]), self.weights, self.horizon)

    def follow(
        self,
        reference: Reference,
        gains: Gains,
        body: Body,
        start: Vector,
        watch: Callable[[], None] = lambda: None,
    ) -> Track:
        """Fly a body along a reference; ``watch`` is called at every node and may raise.

        Raises RunawayError and UnseenError.
        """
        driven = list(self.model.driven)
        lower, upper = self.limits[:, 0], self.limits[:, 1]
        times, ahead = reference.times, reference.controls.T
        corrections = np.stack([gains.nodes, gains.middles, gains.middles], axis=1)
        states, before, after = [start], [], []
        seen = [body.see(start, float(times[0]))]
        for k in range(gains.nodes.shape[0]):
            watch()
            off = seen[-1][driven] - reference.states[driven, 2 * k]
            if not np.isfinite(off).all():
                raise UnseenError(f"a state is not finite at t = {times[2 * k]:.6g}")
            values = (corrections[k] @ off + ahead[2 * k : 2 * k + 3]).clip(lower, upper)
            for place in (0, 1):
                instant = 2 * k + place
                states.append(
                    body.fly(states[-1], times[instant], times[instant + 1], values[place], values[place + 1])
                )
                seen.append(body.see(states[-1], float(times[instant + 1])))
                before.append(values[place])
                after.append(values[place + 1])
        return Track(times, np.array(states), np.array(seen).T, np.array(before), np.array(after))
