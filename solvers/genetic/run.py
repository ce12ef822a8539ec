"""One run of the search, by one of two variants; what it finds does not depend on other runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.genetic.stage import Stage
from solvers.optimizers.cma_es import adapt_covariance
from solvers.optimizers.genetic import ClassicOperators, Generation, Watch
from solvers.spec import GeneticMethod

Vector = NDArray[np.float64]

# The size of the first moves, in genes.
_FIRST_SIGMA = 1.0


@dataclass(frozen=True)
class Order:
    """Which run, counted from 0: its random numbers differ from those of others; how many ``generations``."""

    number: int
    generations: int


@dataclass(frozen=True)
class Population:
    """Where the operators of the paper leave off: ``genes`` (P, G), and the random numbers that go on."""

    genes: Vector
    random: np.random.Generator


def run(stage: Stage, method: GeneticMethod, order: Order, watch: Watch) -> Population | None:
    """Search from the guess; the last population of the operators of the paper.

    Raises what ``watch`` and the fitness of the stage raise.
    """
    first = stage.genome.first()
    if method.variant == "modern":
        adapt(stage, method, order, first, _FIRST_SIGMA, watch)
        return None
    random = np.random.default_rng(_seed(method, order) if order.number else method.seed)
    genes = first + _FIRST_SIGMA * random.standard_normal((method.population, first.size))
    return evolve(stage, method, Population(genes, random), order.generations, watch)


def evolve(
    stage: Stage, method: GeneticMethod, population: Population, generations: int, watch: Watch
) -> Population:
    """So many generations by the operators of the paper."""
    operators = ClassicOperators(
        method.crossover_probability, method.mutation_probability, method.mutation_sigma, method.elite
    )
    last = operators.evolve(stage.fitness, population.genes, generations, population.random, watch)
    return Population(last.genes, population.random)


def adapt(
    stage: Stage, method: GeneticMethod, order: Order, mean: Vector, sigma: float, watch: Watch
) -> None:
    """At most so many generations of covariance matrix adaptation around genes ``mean`` (G,)."""
    coordinates = stage.coordinates
    if coordinates.size == 0:  # the end conditions leave nothing to choose
        watch(Generation(coordinates.origin[None, :], stage.fitness(coordinates.origin[None, :])))
        return
    adapt_covariance(
        lambda moved: stage.fitness(coordinates.genes(moved)),
        coordinates.of(mean),
        sigma,
        method.population,
        order.generations,
        int(_seed(method, order).generate_state(1)[0]),
        lambda now: watch(Generation(coordinates.genes(now.genes), now.fitness)),
    )


def _seed(method: GeneticMethod, order: Order) -> np.random.SeedSequence:
    return np.random.SeedSequence(method.seed, spawn_key=(order.number,))
