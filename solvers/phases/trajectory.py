"""The trajectory of a flight of phases: the trajectory of each, end to end."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.trajectory import Trajectory, all_within

Vector = NDArray[np.float64]

Sampler = Callable[[int, Vector], dict[str, Any]]
"""The samples of a phase at times within it: ``t`` and tables of lists by name."""

# Within this part of a phase its end counts as met.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class PhasedTrajectory:
    """Trajectories of K phases with their names, the next one beginning when the one before ends."""

    parts: tuple[Trajectory, ...]
    names: tuple[str, ...]

    @property
    def t0(self) -> float:
        """When the first phase begins."""
        return self.parts[0].t0

    @property
    def tf(self) -> float:
        """When the last phase ends."""
        return self.parts[-1].tf

    @property
    def edges(self) -> Vector:
        """Begin of the first phase and end of every phase, (K + 1,)."""
        return np.array([self.t0, *(part.tf for part in self.parts)])

    @property
    def design(self) -> dict[str, float]:
        """The design parameters that belong to it."""
        return {name: value for part in self.parts for name, value in part.design.items()}

    @property
    def finite(self) -> bool:
        """Whether all curves have finite values; those of an iterate that diverged may have none."""
        return all(part.finite for part in self.parts)

    def covers(self, times: Vector) -> bool:
        """Whether all times lie within [t0, tf], but for rounding."""
        return all_within(times, self.t0, self.tf)

    def owners(self, times: Vector) -> NDArray[np.int64]:
        """The phase (K,) to which each time belongs.

        Where two phases meet, a time that stands twice in a row belongs to the first one, then to the second
        one; one that stands alone to the second one.
        """
        inner = self.edges[1:-1]
        margins = _ROUNDING * np.array([part.duration for part in self.parts[1:]])
        after = np.searchsorted(inner - margins, times, side="right")
        first = np.append(times[1:] == times[:-1], False)
        met = (
            np.abs(times - inner[np.maximum(after, 1) - 1]) <= margins[np.maximum(after, 1) - 1]
            if (inner.size)
            else np.zeros(times.size, bool)
        )
        return np.asarray(np.where(first & met & (after > 0), after - 1, after), np.int64)

    def by_phase(self, times: Vector, sampler: Sampler) -> list[dict[str, Any]]:
        """The samples of each phase at those of these times that belong to it."""
        owners = self.owners(times)
        return [
            sampler(k, times[owners == k]) if (owners == k).any() else _nothing(part)
            for k, part in enumerate(self.parts)
        ]

    def sample(self, times: Vector, *, derivatives: bool = False) -> dict[str, Any]:
        """See :meth:`~solvers.trajectory.Trajectory.sample`; None where a phase does not have a name."""
        return joined(self.by_phase(times, lambda k, own: self.parts[k].sample(own, derivatives=derivatives)))

    @classmethod
    def from_result(cls, result: Mapping[str, Any]) -> PhasedTrajectory:
        """The trajectory of a stored result, exactly as it was returned.

        Raises KeyError where the result has no coefficients of a basis that this version knows.
        """
        nodes, parts = result["nodes"], []
        for phase, coefficients in zip(result["phases"], result["coefficients"]["phases"], strict=True):
            own = slice(phase["nodes"][0], phase["nodes"][1] + 1)
            controls = {name: nodes["controls"][name][own] for name in phase["controls"]}
            alone = {
                "nodes": {"t": nodes["t"][own], "controls": controls},
                "trajectory": {"states": phase["states"]},
                "coefficients": coefficients,
                "design": phase["design"],
            }
            parts.append(Trajectory.from_result(alone))
        return cls(tuple(parts), tuple(phase["name"] for phase in result["phases"]))


def _nothing(part: Trajectory) -> dict[str, Any]:
    """The samples of a phase at no time."""
    return {
        "t": [],
        "states": {name: [] for name in part.states},
        "controls": {name: [] for name in part.controls},
    }


def joined(samples: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Samples of phases one after the other; None where a phase does not have a name."""
    counts = [len(sample["t"]) for sample in samples]
    keys = dict.fromkeys(key for sample in samples for key in sample if key != "t")
    whole: dict[str, Any] = {"t": [time for sample in samples for time in sample["t"]]}
    for key in keys:
        names = dict.fromkeys(name for sample in samples for name in sample.get(key, {}))
        whole[key] = {
            name: [
                value
                for sample, count in zip(samples, counts, strict=True)
                for value in sample.get(key, {}).get(name, [None] * count)
            ]
            for name in names
        }
    return whole


AnyTrajectory = Trajectory | PhasedTrajectory


def trajectory_of(result: Mapping[str, Any]) -> AnyTrajectory:
    """The trajectory of any stored result. Raises KeyError as that of its kind does."""
    kind = PhasedTrajectory if "phases" in result["coefficients"] else Trajectory
    return kind.from_result(result)
