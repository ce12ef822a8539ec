"""What a run in another process tells about itself."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solvers.genetic.run import Population
from solvers.optimizers.genetic import Generation

Vector = NDArray[np.float64]


@dataclass
class Record:
    """A run as it goes, or the part of it since it last told.

    ``fitness``: that of the best individual of each generation; ``better``: number of the generation and
    genes of each individual that was better than all before; ``diversity`` of the last generation. A run
    that has ``ended`` by the operators of the paper tells its ``population``.
    """

    fitness: list[float] = field(default_factory=list)
    better: list[tuple[int, Vector]] = field(default_factory=list)
    diversity: float = 0.0
    population: Population | None = None
    ended: bool = False

    def append(self, part: Record) -> None:
        """Take note of what followed."""
        self.fitness += part.fitness
        self.better += part.better
        self.diversity, self.population, self.ended = part.diversity, part.population, part.ended

    def best(self, generations: int) -> tuple[Vector, float] | None:
        """The genes and the fitness of the best of the first ``generations``; None where there is none."""
        known = [(number, genes) for number, genes in self.better if number < generations]
        return (known[-1][1], self.fitness[known[-1][0]]) if known else None


class Recorder:
    """Takes note of the generations of one run; :meth:`part` is what has not been told yet."""

    def __init__(self) -> None:
        self._part = Record()
        self._generations, self._best = 0, np.inf
        self._last: Generation | None = None

    def add(self, generation: Generation) -> None:
        """Take note of a generation."""
        index = generation.best
        fitness = float(generation.fitness[index])
        if fitness < self._best or self._generations == 0:
            self._best = fitness
            self._part.better.append((self._generations, generation.genes[index].copy()))
        self._part.fitness.append(fitness)
        self._generations += 1
        self._last = generation

    def part(self) -> Record:
        """What happened since the last call."""
        part, self._part = self._part, Record()
        if self._last is not None:
            part.diversity = self._last.diversity
        return part
