"""States and controls as functions of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.coefficients import decode
from solvers.curves import Curve, DerivativeCurve

Vector = NDArray[np.float64]

# From a normalised time to its time and back.
_ROUNDING = 1e-12
# Times that somebody has printed and read again.
_MARGIN = 1e-9


@dataclass(frozen=True)
class Trajectory:
    """What a method returns: a curve over tau = (t - t0) / (tf - t0) for each state and control, by name.

    ``interpolation`` names how the controls are to be read between nodes. ``basis`` names the functions
    behind the curves (:mod:`solvers.coefficients`). ``breakpoints``: ascending tau from 0 to 1, between which
    every curve is smooth. ``nodes``: the tau at which the dynamics were imposed, and both ends. ``design``:
    the design parameters that belong to it.
    """

    t0: float
    tf: float
    states: Mapping[str, Curve]
    controls: Mapping[str, Curve]
    interpolation: str
    basis: Mapping[str, Any]
    breakpoints: Vector
    nodes: Vector
    design: Mapping[str, float] = field(default_factory=dict)

    @property
    def parts(self) -> tuple[Trajectory, ...]:
        """The trajectory of each phase: this one alone."""
        return (self,)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the phases: it is none."""
        return ("",)

    @property
    def duration(self) -> float:
        """tf - t0."""
        return self.tf - self.t0

    @property
    def finite(self) -> bool:
        """Whether all curves have finite values; those of an iterate that diverged may have none."""
        values = self.states_at(self.breakpoints), self.controls_at(self.breakpoints)
        return all(bool(np.isfinite(rows).all()) for rows in values)

    def interpolation_of(self, control: str) -> str:
        """How a control is to be read between nodes; the slope of straight lines holds until the next one."""
        return "previous" if isinstance(self.controls[control], DerivativeCurve) else self.interpolation

    def time(self, tau: Vector) -> Vector:
        """Times of normalised times."""
        return self.t0 + self.duration * tau

    def tau(self, times: Vector) -> Vector:
        """Normalised times of times, clipped to [0, 1]."""
        return np.clip((times - self.t0) / self.duration, 0.0, 1.0)

    def covers(self, times: Vector) -> bool:
        """Whether all times lie within [t0, tf], but for rounding."""
        return all_within(times, self.t0, self.tf)

    def states_at(self, tau: Vector) -> Vector:
        """States, (n, K)."""
        return np.array([curve(tau) for curve in self.states.values()]).reshape(-1, tau.size)

    def controls_at(self, tau: Vector) -> Vector:
        """Controls, (m, K)."""
        return np.array([curve(tau) for curve in self.controls.values()]).reshape(-1, tau.size)

    def states_by_name(self, tau: Vector) -> dict[str, Vector]:
        """States by name, (K,) each."""
        return {name: curve(tau) for name, curve in self.states.items()}

    def controls_by_name(self, tau: Vector) -> dict[str, Vector]:
        """Controls by name, (K,) each."""
        return {name: curve(tau) for name, curve in self.controls.items()}

    def rates_at(self, tau: Vector) -> Vector:
        """Time derivatives of the states, (n, K)."""
        return np.array([curve(tau, 1) / self.duration for curve in self.states.values()]).reshape(
            -1, tau.size
        )

    @classmethod
    def from_result(cls, result: Mapping[str, Any]) -> Trajectory:
        """The trajectory of a stored result, exactly as it was returned.

        Raises KeyError where the result has no coefficients of a basis that this version knows.
        """
        times = result["nodes"]["t"]
        decoded = decode(result["coefficients"], result["nodes"]["controls"], times[-1] - times[0])
        names = result["trajectory"]["states"]
        return cls(
            t0=times[0],
            tf=times[-1],
            states={name: decoded.states[name] for name in names},
            controls=decoded.controls,
            interpolation=decoded.interpolation,
            basis=result["coefficients"]["basis"],
            breakpoints=decoded.breakpoints,
            nodes=decoded.nodes,
            design=result.get("design", {}),
        )

    def sample(self, times: Vector, *, derivatives: bool = False) -> dict[str, Any]:
        """The ``trajectory`` of a result at these times: ``t``, ``states``, ``controls``, and ``rates``.

        Times outside [t0, tf] take the value at the nearer end. Where a control jumps, a time that stands
        twice in a row gives its left and its right value, one that stands alone the right one.
        """
        tau = self.one_sided(times)
        sampled: dict[str, Any] = {
            "t": times.tolist(),
            "states": {name: curve(tau).tolist() for name, curve in self.states.items()},
            "controls": {name: curve(tau).tolist() for name, curve in self.controls.items()},
        }
        if derivatives:
            rates = self.rates_at(tau)
            sampled["rates"] = {name: rate.tolist() for name, rate in zip(self.states, rates, strict=True)}
        return sampled

    def one_sided(self, times: Vector) -> Vector:
        """Normalised times; at a breakpoint exactly that, before it the first of two equal times in a row."""
        tau = self.tau(times)
        after = np.clip(np.searchsorted(self.breakpoints, tau), 1, self.breakpoints.size - 1)
        left, right = self.breakpoints[after - 1], self.breakpoints[after]
        nearest = np.where(tau - left < right - tau, left, right)
        at_break = np.abs(tau - nearest) <= _ROUNDING
        first = np.append(times[1:] == times[:-1], False)
        return np.where(at_break, np.where(first, np.nextafter(nearest, 0.0), nearest), tau)


def all_within(times: Vector, t0: float, tf: float) -> bool:
    """Whether all times lie within [t0, tf], but for rounding."""
    margin = _MARGIN * (tf - t0)
    return bool(np.all((times >= t0 - margin) & (times <= tf + margin)))
