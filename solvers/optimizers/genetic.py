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
        wheel = np.cumsum(chances(parents.fitness))
        drawn = np.searchsorted(wheel, random.random(count) * wheel[-1], side="right")
        genes: Vector = parents.genes[drawn]
        pairs = genes[: count - count % 2].reshape(-1, 2, size)
        crossed = random.random(len(pairs)) < self.crossover_probability
        places = np.where(crossed, random.integers(1, max(size, 2), len(pairs)), size)
        tails = np.arange(size) >= places[:, None]
        pairs[:] = np.where(tails[:, None, :], pairs[:, ::-1], pairs)
        mutated = np.flatnonzero(random.random(genes.size) < self.mutation_probability)
        genes.ravel()[mutated] += self.mutation_sigma * random.standard_normal(mutated.size)
        return genes

    def _with_elite(self, before: Generation, now: Generation) -> Generation:
        """The elite of the generation before in place of the worst; in the arrays of this one."""
        if self.elite == 1:  # without sorting
            best, worst = before.best, int(np.argmax(now.fitness))
            now.genes[worst], now.fitness[worst] = before.genes[best], before.fitness[best]
        elif self.elite:
            order = np.argsort(before.fitness, kind="stable")[: self.elite]
            last = np.argsort(now.fitness, kind="stable")[-self.elite :]
            now.genes[last], now.fitness[last] = before.genes[order], before.fitness[order]
        return now


def chances(fitness: Vector) -> Vector:
    """The chances of selection, proportional to 1/J; what is not finite has none.

    Where some J is not positive, all are raised until the best is a thousandth of their spread.
    """
    finite = np.isfinite(fitness)
    if not finite.all():
        weights = np.zeros(fitness.size)
        weights[finite] = chances(fitness[finite]) if finite.any() else 0.0
        return weights if finite.any() else np.full(fitness.size, 1.0 / fitness.size)
    best = fitness.min()
    if best <= 0.0:
        fitness = fitness - best + max(1e-3 * float(np.ptp(fitness)), 1e-300)
    weights = 1.0 / fitness
    return np.asarray(weights / weights.sum(), np.float64)
