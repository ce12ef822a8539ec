"""Evolution strategy with covariance matrix adaptation (Hansen and Ostermeier 2001), by the library cmaes.

It is the best of the evolutionary methods measured here on coefficients of controls: exact to rounding where
differential evolution and genetic operators stop at some thousandths (docs/methods/genetic.md).
"""

from __future__ import annotations

import numpy as np
from cmaes import CMA, SepCMA
from numpy.typing import NDArray

from solvers.optimizers.genetic import Fitness, Generation, Watch

Vector = NDArray[np.float64]

# With more genes the full covariance matrix costs more than it gains.
_LARGEST_FULL = 200
# What has no value counts as this bad: the library wants numbers.
_WORST = 1e300


def adapt_covariance(
    fitness: Fitness, mean: Vector, sigma: float, population: int, generations: int, seed: int, watch: Watch
) -> Generation:
    """Minimise from a normal population around ``mean`` (G,); the last generation.

    Ends where the strategy has converged, or after so many generations. Raises what ``fitness`` and ``watch``
    raise.
    """
    strategy = (CMA if mean.size <= _LARGEST_FULL else SepCMA)(
        mean, sigma, seed=seed, population_size=population
    )
    now = Generation(mean[None, :], np.full(1, np.inf))
    for _ in range(generations):
        genes = np.array([strategy.ask() for _ in range(population)])
        now = Generation(genes, fitness(genes))
        watch(now)
        strategy.tell(list(zip(genes, np.minimum(now.fitness, _WORST), strict=True)))
        if strategy.should_stop():
            break
    return now
