"""What a simulation of a population gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.genetic.genome import Individuals

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Simulated:
    """What P individuals do.

    ``final`` (n, P) states; ``cost`` (P,) the integral of the running cost, ``integrals`` (k, P) those of the
    problem; ``violation`` (P,) the mean over time of the squares of what bounds and path constraints forbid.
    """

    final: Vector
    cost: Vector
    integrals: Vector
    violation: Vector


class Simulator(Protocol):
    """States of a population, by whatever means the model allows."""

    @property
    def block(self) -> int:
        """How many individuals are best simulated at once."""
        ...

    def simulate(self, individuals: Individuals) -> Simulated:
        """Simulate every individual."""
        ...
