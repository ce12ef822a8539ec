"""The genetic algorithm of the paper, to the letter: real genes, roulette, one-point crossover, mutation.

A generation: as many parents as there are individuals are drawn with chances proportional to 1/J; consecutive
pairs exchange the tails of their genes behind a random place with the crossover probability; every gene is
moved by a normal number with the mutation probability. The elite of the generation before replaces the worst.

Source: Zhang, Ge, Liu (1999), section 4. It gives neither the size of a mutation nor an elite: both are
options.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Fitness = Callable[[Vector], Vector]
"""From genes (P, G) to what is minimised, (P,)."""
Watch = Callable[["Generation"], None]
"""Told every generation; may raise to stop."""

# What chance decides is drawn for several generations together, up to so many genes.
_DRAWN_TOGETHER = 1 << 16


@dataclass(frozen=True)
class Generation:
    """A generation: its ``genes`` (P, G) and their ``fitness`` (P,)."""

    genes: Vector
    fitness: Vector

    @cached_property
    def best(self) -> int:
        """The index of the best individual."""
        return int(np.argmin(self.fitness))

    @property
    def diversity(self) -> float:
        """The root mean square of how far genes are from their mean."""
        return float(np.sqrt(np.mean(np.var(self.genes, axis=0))))


@dataclass(frozen=True)
class Draw:
    """What chance decides in one generation of P individuals with G genes.

    ``turns`` (P,) of the wheel, in [0, 1); ``sources`` (P, G): which of the genes that were selected, counted
    row by row, a gene comes from; ``moves`` (P, G) by mutation.
    """

    turns: Vector
    sources: NDArray[np.int64]
    moves: Vector

    def children(self, parents: Generation) -> Vector:
        """Selected, crossed and mutated genes."""
        wheel = np.cumsum(chances(parents.fitness))
        selected = parents.genes[wheel.searchsorted(self.turns * wheel[-1], side="right")]
        children: Vector = selected.take(self.sources)
        children += self.moves
        return children


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
        draws = self.draws(genes.shape[0], genes.shape[1], random)
        for _ in range(generations):
            children = next(draws).children(now)
            now = self._with_elite(now, Generation(children, fitness(children)))
            watch(now)
        return now

    def draws(self, count: int, size: int, random: np.random.Generator) -> Iterator[Draw]:
        """What chance decides for ``count`` individuals of ``size`` genes, generation after generation."""
        together = max(1, _DRAWN_TOGETHER // (count * size))
        rows = np.arange(count)
        while True:
            turns = random.random((together, count))
            crossed = random.random((together, count // 2)) < self.crossover_probability
            places = np.where(crossed, random.integers(1, max(size, 2), crossed.shape), size)
            exchanged = np.zeros((together, count, size), bool)
            exchanged[:, : count - count % 2] = np.repeat(np.arange(size) >= places[:, :, None], 2, axis=1)
            partners = np.where(exchanged, (rows ^ 1)[:, None], rows[:, None])
            mutated = np.flatnonzero(random.random(partners.size) < self.mutation_probability)
            moves = np.zeros(partners.shape)
            moves.ravel()[mutated] = self.mutation_sigma * random.standard_normal(mutated.size)
            yield from map(Draw, turns, partners * size + np.arange(size), moves)

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
