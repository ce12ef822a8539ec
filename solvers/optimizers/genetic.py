"""The genetic algorithm of the paper, to the letter: real genes, roulette, one-point crossover, mutation.

A generation: as many parents as there are individuals are drawn with chances proportional to 1/J; consecutive
pairs exchange the tails of their genes behind a random place with the crossover probability; every gene is
moved by a normal number with the mutation probability. The elite of the generation before replaces the worst.

Source: Zhang, Ge, Liu (1999), section 4. It gives neither the size of a mutation nor an elite: both are
options.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Fitness = Callable[[Vector], Vector]
"""From genes (P, G) to what is minimised, (P,)."""
Watch = Callable[["Generation"], None]
"""Told every generation; may raise to stop."""


@dataclass(frozen=True)
class Generation:
    """A generation: its ``genes`` (P, G) and their ``fitness`` (P,)."""

    genes: Vector
    fitness: Vector

    @property
    def best(self) -> int:
        """The index of the best individual."""
        return int(np.argmin(self.fitness))

    @property
    def diversity(self) -> float:
        """The root mean square of how far genes are from their mean."""
        return float(np.sqrt(np.mean(np.var(self.genes, axis=0))))


@dataclass(frozen=True)
class ClassicOperators:
    """The numbers of the operators; ``elite`` individuals survive unchanged."""

    crossover_probability: float
    mutation_probability: float
    mutation_sigma: float
    elite: int

    def evolve(
        self, fitness: Fitness, genes: Vector, generations: int, random: np.random.Generator, watch: Watch
    ) -> Generation:
        """Evolve a population (P, G) for so many generations; the last one.

        Raises what ``fitness`` and ``watch`` raise.
        """
        now = Generation(genes, fitness(genes))
        watch(now)
        for _ in range(generations):
            children = self.children(now, random)
            now = self._with_elite(now, Generation(children, fitness(children)))
            watch(now)
        return now

    def children(self, parents: Generation, random: np.random.Generator) -> Vector:
        """Selected, crossed and mutated genes."""
        count, size = parents.genes.shape
        genes = parents.genes[random.choice(count, count, p=chances(parents.fitness))]
        pairs = count // 2
        crossed = random.random(pairs) < self.crossover_probability
        places = random.integers(1, max(size, 2), pairs)
        tails = (np.arange(size) >= places[:, None]) & crossed[:, None]
        first, second = genes[: 2 * pairs : 2], genes[1 : 2 * pairs : 2]
        genes[: 2 * pairs : 2], genes[1 : 2 * pairs : 2] = (
            np.where(tails, second, first),
            np.where(tails, first, second),
        )
        mutated = random.random(genes.shape) < self.mutation_probability
        genes[mutated] += self.mutation_sigma * random.standard_normal(np.count_nonzero(mutated))
        return np.asarray(genes, np.float64)

    def _with_elite(self, before: Generation, now: Generation) -> Generation:
        if not self.elite:
            return now
        best = np.argsort(before.fitness, kind="stable")[: self.elite]
        worst = np.argsort(now.fitness, kind="stable")[-self.elite :]
        genes, fitness = now.genes, now.fitness.copy()
        genes[worst], fitness[worst] = before.genes[best], before.fitness[best]
        return Generation(genes, fitness)


def chances(fitness: Vector) -> Vector:
    """The chances of selection, proportional to 1/J; what is not finite has none.

    Where some J is not positive, all are raised until the best is a thousandth of their spread.
    """
    finite = np.isfinite(fitness)
    if not finite.any():
        return np.full(fitness.size, 1.0 / fitness.size)
    values = fitness[finite]
    if values.min() <= 0.0:
        values = values - values.min() + max(1e-3 * float(np.ptp(values)), 1e-300)
    weights = np.zeros(fitness.size)
    weights[finite] = values.min() / values
    return np.asarray(weights / weights.sum(), np.float64)
