"""What flights side by side did: ends, extremes, misses; and all legs of them together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass
class Extremes:
    """Smallest and largest value so far of each flight (P,), by name."""

    low: dict[str, Vector] = field(default_factory=dict)
    high: dict[str, Vector] = field(default_factory=dict)

    def see(self, values: Mapping[str, Vector]) -> None:
        """Take note of an instant."""
        for name, row in values.items():
            self.low[name] = np.minimum(self.low.get(name, row), row)
            self.high[name] = np.maximum(self.high.get(name, row), row)

    def amplitudes(self) -> dict[str, Vector]:
        """Half of the distance between both, by name."""
        return {name: (self.high[name] - self.low[name]) / 2.0 for name in self.low}


@dataclass(frozen=True)
class Missed:
    """A limit of the document, its ``scale``, and by how much each flight misses it (P,)."""

    pointer: str
    name: str
    scale: float
    excess: Vector


@dataclass(frozen=True)
class Flown:
    """What P flights did, each value (P,); the first is the undisturbed one.

    ``lost``: could not be followed to the end. ``final`` and ``outputs``: at the end of the flight;
    ``extremes``: of the outputs on it; ``swings``: the amplitudes of states and outputs after it.
    """

    lost: NDArray[np.bool_]
    final: Mapping[str, Vector]
    outputs: Mapping[str, Vector]
    extremes: Extremes
    objective: Vector
    missed: Sequence[Missed]
    swings: Mapping[str, Vector]
    end: float
    steps: int


def together(legs: Sequence[Flown], objective: Vector | float, missed: Sequence[Missed]) -> Flown:
    """The legs of the same flights as one, with what counts over all of them: a cost, and limits.

    A limit of several legs is missed by what any of them misses.
    """
    extremes = Extremes()
    for leg in legs:
        extremes.see(leg.extremes.low)
        extremes.see(leg.extremes.high)
    limits: dict[str, Missed] = {}
    for item in [*(item for leg in legs for item in leg.missed), *missed]:
        known = limits.setdefault(item.pointer, item)
        scale, excess = max(known.scale, item.scale), np.maximum(known.excess, item.excess)
        limits[item.pointer] = replace(known, scale=scale, excess=excess)
    return replace(
        legs[-1],
        final={name: values for leg in legs for name, values in leg.final.items()},
        outputs={name: values for leg in legs for name, values in leg.outputs.items()},
        extremes=extremes,
        objective=sum((leg.objective for leg in legs), start=np.zeros(1)) + objective,
        missed=list(limits.values()),
        steps=sum(leg.steps for leg in legs),
    )
