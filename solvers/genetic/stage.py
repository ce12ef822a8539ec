"""A stage of the search: the genes of some functions, how they are judged, and which of them move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from solvers.genetic.basis import basis_of
from solvers.genetic.coordinates import Coordinates
from solvers.genetic.fitness import Fitness
from solvers.genetic.genome import Genome
from solvers.genetic.model import ArrayModel
from solvers.genetic.quadrature import QuadratureSimulator
from solvers.genetic.simulators import simulator_of
from solvers.part import Part
from solvers.phases.trajectory import AnyTrajectory
from solvers.problem import OptimalControlProblem
from solvers.spec import GeneticMethod
from solvers.start.earlier import starts_from
from solvers.start.guess import Start
from solvers.start.scaling import Scaling


@dataclass(frozen=True, eq=False)
class Stage:
    """The genes with some levels of wavelets; ``coordinates``: what of them is searched."""

    genome: Genome
    fitness: Fitness
    coordinates: Coordinates


@dataclass(frozen=True)
class Stages:
    """What all stages of a search have in common."""

    model: ArrayModel
    scaling: Scaling
    method: GeneticMethod
    start: Start

    @classmethod
    def of(
        cls,
        problem: OptimalControlProblem,
        scaling: Scaling,
        method: GeneticMethod,
        earlier: AnyTrajectory | None,
    ) -> Stages:
        """Those of a problem; they start from its guess, or from an ``earlier`` answer."""
        (start,) = [problem.guess] if earlier is None else starts_from(earlier, [Part(problem, scaling)])
        return cls(ArrayModel(problem), scaling, method, start)

    def at(self, levels: int, pause: Callable[[], None] = lambda: None) -> Stage:
        """The stage with so many levels of wavelets; ``pause``: see :class:`Fitness`."""
        method = self.method
        basis = replace(basis_of(method), levels=levels)
        genome = Genome(self.model.problem, self.scaling, basis, self.start)
        simulator = simulator_of(self.model, genome)
        coordinates = Coordinates.all(genome.size)
        if method.eliminates and isinstance(simulator, QuadratureSimulator):
            coordinates = Coordinates.on(*genome.end_equations(simulator))
        return Stage(genome, Fitness(self.model, genome, simulator, method.penalty, pause), coordinates)
