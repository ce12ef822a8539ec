"""Which simulator a model allows, and how fine it has to be."""

from __future__ import annotations

from solvers.genetic.genome import Genome
from solvers.genetic.model import ArrayModel
from solvers.genetic.quadrature import QuadratureSimulator, find_chains
from solvers.genetic.runge_kutta import RungeKuttaSimulator

# Dyadic intervals at least: of a search by quadrature, and by Runge-Kutta steps.
_QUADRATURE = 80
_STEPS = 160
# Tables of more numbers than these are not worth having.
_LARGEST_TABLE = 20_000_000


def simulator_of(model: ArrayModel, genome: Genome) -> QuadratureSimulator | RungeKuttaSimulator:
    """For a search: quadrature where the model allows it, Runge-Kutta steps elsewhere."""
    level = genome.basis.level_for(_QUADRATURE)
    chains = find_chains(model) if genome.fixed else None
    if chains is not None and genome.size * (genome.basis.units << level) <= _LARGEST_TABLE:
        return QuadratureSimulator(model, genome, chains, level)
    return RungeKuttaSimulator(model, genome, genome.basis.level_for(_STEPS))
