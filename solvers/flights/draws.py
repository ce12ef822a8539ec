"""What is drawn for every flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.spec.flights import Distribution, FlightsSpec

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Draws:
    """Values for P runs by name, each (P,): of parameters, and of states at t0."""

    runs: int
    parameters: Mapping[str, Vector]
    initial_state: Mapping[str, Vector]

    def part(self, start: int, stop: int) -> Draws:
        """What was drawn for the runs from ``start`` up to ``stop``."""
        return Draws(
            min(stop, self.runs) - start,
            {name: values[start:stop] for name, values in self.parameters.items()},
            {name: values[start:stop] for name, values in self.initial_state.items()},
        )

    def of(self, run: int) -> dict[str, dict[str, float]]:
        """What was drawn for one flight."""
        return {
            "parameters": {name: float(values[run]) for name, values in self.parameters.items()},
            "initial_state": {name: float(values[run]) for name, values in self.initial_state.items()},
        }


def draw(spec: FlightsSpec) -> Draws:
    """Draw for all runs.

    Every name has a stream of its own, told by the seed and the name: more runs go on where fewer ended, and
    what else is drawn changes nothing.
    """

    def table(key: str) -> dict[str, Vector]:
        return {
            name: _drawn(item, np.random.default_rng([spec.seed, *f"{key}/{name}".encode()]), spec.runs)
            for name, item in getattr(spec, key).items()
        }

    return Draws(spec.runs, table("parameters"), table("initial_state"))


def _drawn(item: Distribution, stream: np.random.Generator, count: int) -> Vector:
    numbers = np.array(item.numbers, np.float64)
    match item.kind:
        case "uniform":
            return stream.uniform(numbers[0], numbers[1], count)
        case "normal":
            return stream.normal(numbers[0], numbers[1], count)
    chosen: Vector = numbers[stream.integers(numbers.size, size=count)]
    return chosen
