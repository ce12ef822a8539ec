"""How a search got better."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

_LONGEST = 20_000


@dataclass
class History:
    """The best fitness so far, generation by generation; of very long searches every 2nd, 4th, ... one."""

    values: list[float] = field(default_factory=list)
    best: float = np.inf
    generations: int = 0
    stride: int = 1

    def add(self, fitness: float) -> None:
        """Take note of a generation."""
        self.best = min(self.best, fitness)
        if self.generations % self.stride == 0:
            self.values.append(self.best)
        self.generations += 1
        if len(self.values) > _LONGEST:
            self.values = self.values[::2]
            self.stride *= 2
