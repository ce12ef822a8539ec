"""What of a control is flown: its values within the bounds, and where these have corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solvers.formulation.quantities import Interval
from solvers.trajectory import Trajectory
from solvers.verification.violations import clipped

Vector = NDArray[np.float64]

_SAMPLES_PER_ARC = 16
_TOUCHING = 1e-9
_BISECTIONS = 45


class FlownControls:
    """The controls of a trajectory as they are flown: clipped to their bounds.

    ``corners``: normalised times at which the model has corners. ``breakpoints``: ascending ones from 0 to 1
    between which controls and model are smooth.
    """

    def __init__(self, trajectory: Trajectory, bounds: Sequence[Interval], corners: Vector) -> None:
        self.trajectory = trajectory
        self.bounds = np.array(bounds, np.float64).reshape(-1, 2)
        self.breakpoints = np.union1d(
            trajectory.breakpoints, np.append(self._crossings(), self._apart(corners))
        )

    def clipped(self, tau: Vector) -> Vector:
        """Controls (m, len(tau)) as flown."""
        return clipped(self.trajectory.controls_at(tau), self.bounds)

    def _crossings(self) -> Vector:
        """Where a control crosses a bound between breakpoints: the clipped control has a corner there."""
        breaks = self.trajectory.breakpoints
        fractions = np.linspace(0.0, 1.0, _SAMPLES_PER_ARC + 1)
        tau = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * fractions[:-1]).ravel(), 1.0)
        found = [np.zeros(0)]
        for curve, bounds in zip(self.trajectory.controls.values(), self.bounds, strict=True):
            values = curve(tau)
            # A control that rests on its bound touches it by rounding: only what leaves it has a corner.
            slack = _TOUCHING * max(1.0, float(np.max(np.abs(values))))
            for bound, sign in zip(bounds, (-1.0, 1.0), strict=True):
                if np.isfinite(bound):
                    limit = sign * bound + slack
                    outside = sign * values > limit
                    change = np.flatnonzero(outside[1:] != outside[:-1])
                    if not change.size:
                        continue
                    low, high, side = tau[change], tau[change + 1], outside[change]
                    for _ in range(_BISECTIONS):
                        middle = 0.5 * (low + high)
                        same = (sign * curve(middle) > limit) == side
                        low, high = np.where(same, middle, low), np.where(same, high, middle)
                    found.append(0.5 * (low + high))
        return self._apart(np.concatenate(found))

    def _apart(self, places: Vector) -> Vector:
        """Those of these normalised times that are no breakpoints of the trajectory."""
        nearest = np.min(np.abs(places[:, None] - self.trajectory.breakpoints), axis=1, initial=1.0)
        apart: Vector = places[nearest > 1e-10]
        return apart
