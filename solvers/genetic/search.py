"""The search: stage after stage of basis functions, by one of two variants, watched."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solvers.errors import OndeletteError
from solvers.genetic.basis import basis_of
from solvers.genetic.coordinates import Coordinates
from solvers.genetic.fitness import Evaluation, Fitness
from solvers.genetic.genome import Genome
from solvers.genetic.history import History
from solvers.genetic.model import ArrayModel
from solvers.genetic.quadrature import QuadratureSimulator
from solvers.genetic.simulators import simulator_of
from solvers.guess import Start
from solvers.optimizers.cma_es import adapt_covariance
from solvers.optimizers.genetic import ClassicOperators, Generation
from solvers.progress import ProgressReport
from solvers.session import Session
from solvers.spec import GeneticMethod
from solvers.status import SolveStatus

Vector = NDArray[np.float64]

# Sizes of the first moves, in genes: of a search from the guess, and from the answer of the stage before.
_FIRST_SIGMA = 1.0
_NEXT_SIGMA = 0.3
# Two runs that come this near to each other, relative to J, have found the same answer.
_SAME = 1e-6
_REPORT_EVERY = 0.1  # seconds


class Stopped(OndeletteError):
    """Somebody or the clock asks to stop."""

    def __init__(self, status: SolveStatus) -> None:
        super().__init__(status.sentence)
        self.status = status


@dataclass(frozen=True, eq=False)
class Found:
    """The best individual of a run: its genes (G,) and what they stand for."""

    genome: Genome
    genes: Vector
    fitness: float = np.inf


@dataclass(frozen=True)
class _Stage:
    """The genes of a basis, how they are judged, and which of them move."""

    genome: Genome
    fitness: Fitness
    coordinates: Coordinates


@dataclass
class Search:
    """A search as it runs; ``runs`` are the best individuals of independent runs.

    ``deadline`` (of ``time.monotonic()``) ends it; ``share``: the part of all work that it is.
    """

    session: Session
    method: GeneticMethod
    start: Start
    deadline: float
    share: float
    history: History = field(default_factory=History)
    runs: list[Found] = field(default_factory=list)
    stopped: SolveStatus | None = None

    def __post_init__(self) -> None:
        self.model = ArrayModel(self.session.problem)
        self._next_report = 0.0

    @property
    def best(self) -> Found:
        """The best of all runs; a run that went on with finer functions is."""
        return min(self.runs, key=lambda run: (-run.genome.basis.levels, run.fitness))

    def run(self) -> None:
        """Search; a search that is stopped keeps what it has. Raises what the session's progress raises."""
        try:
            if self.method.variant == "classic":
                self._classic()
            else:
                self._modern()
        except Stopped as stop:
            self.stopped = stop.status

    def judged(self, run: Found) -> Evaluation:
        """Objective, residual and violation of the best individual of a run, (1,) each."""
        simulator = simulator_of(self.model, run.genome)
        return Fitness(self.model, run.genome, simulator, self.method.penalty).evaluate(run.genes[None, :])

    def _classic(self) -> None:
        method = self.method
        random = np.random.default_rng(method.seed)
        operators = ClassicOperators(
            method.crossover_probability, method.mutation_probability, method.mutation_sigma, method.elite
        )
        self._enter(0)
        first = self._stage.genome.first()
        self._begin_run(first)
        genes = first + _FIRST_SIGMA * random.standard_normal((method.population, first.size))
        for levels in range(method.wavelet_levels + 1):
            if levels:
                genes = self._refine(levels, genes)
            generations = method.refine_generations if levels else method.generations
            genes = operators.evolve(self._stage.fitness, genes, generations, random, self._watch).genes

    def _modern(self) -> None:
        """Runs from the guess until the best is found twice or no generations are left; then finer functions.

        Generations that the first stage leaves are there for the next ones.
        """
        method = self.method
        seeds = np.random.SeedSequence(method.seed)
        self._enter(0)
        first = self._stage.genome.first()
        while self.history.generations < method.generations and not self._found_twice():
            self._begin_run(first)
            self._adapt(first, _FIRST_SIGMA, method.generations - self.history.generations, seeds)
        self._run = self.runs.index(self.best)
        for levels in range(1, method.wavelet_levels + 1):
            self._refine(levels, self.best.genes[None, :])
            stages_left = method.wavelet_levels + 1 - levels
            left = (method.budget - self.history.generations) // stages_left
            self._adapt(self.best.genes, _NEXT_SIGMA, left, seeds)

    def _found_twice(self) -> bool:
        reached = sorted(run.fitness for run in self.runs)
        return len(reached) > 1 and reached[1] - reached[0] <= _SAME * abs(reached[0])

    def _adapt(self, mean: Vector, sigma: float, generations: int, seeds: np.random.SeedSequence) -> None:
        stage, coordinates = self._stage, self._stage.coordinates
        seed = int(seeds.spawn(1)[0].generate_state(1)[0])
        if coordinates.size == 0:  # the end conditions leave nothing to choose
            self._watch(Generation(coordinates.origin[None, :], stage.fitness(coordinates.origin[None, :])))
            return
        adapt_covariance(
            lambda moved: stage.fitness(coordinates.genes(moved)),
            coordinates.of(mean),
            sigma,
            self.method.population,
            generations,
            seed,
            lambda now: self._watch(Generation(coordinates.genes(now.genes), now.fitness)),
        )

    def _begin_run(self, genes: Vector) -> None:
        self.runs.append(Found(self._stage.genome, genes))
        self._run = len(self.runs) - 1

    def _enter(self, levels: int) -> None:
        """Begin the stage with so many levels of wavelets."""
        method, session = self.method, self.session
        basis = replace(basis_of(method), levels=levels)
        genome = Genome(session.problem, session.scaling, basis, self.start)
        simulator = simulator_of(self.model, genome)
        coordinates = Coordinates.all(genome.size)
        if method.eliminates and isinstance(simulator, QuadratureSimulator):
            coordinates = Coordinates.on(*genome.end_equations(simulator))
        fitness = Fitness(self.model, genome, simulator, method.penalty, self._pause)
        self._stage = _Stage(genome, fitness, coordinates)

    def _refine(self, levels: int, genes: Vector) -> Vector:
        """Begin the next stage; the same individuals with the genes of its wavelets, at zero."""
        coarse, run = self._stage.genome, self.runs[self._run]
        self._enter(levels)
        stage = self._stage
        best = coarse.extended(run.genes[None, :], stage.genome)
        self.runs[self._run] = Found(stage.genome, best[0], float(stage.fitness(best)[0]))
        return coarse.extended(genes, stage.genome)

    def _pause(self) -> None:
        if self.session.progress.cancelled():
            raise Stopped(SolveStatus.CANCELLED)
        if time.monotonic() >= self.deadline:
            raise Stopped(SolveStatus.TIME_LIMIT)

    def _watch(self, generation: Generation) -> None:
        """Keep the best of the run, tell how it goes."""
        index = generation.best
        run, fitness = self.runs[self._run], float(generation.fitness[index])
        if fitness < run.fitness:
            self.runs[self._run] = replace(run, genes=generation.genes[index].copy(), fitness=fitness)
        self.history.add(fitness)
        now = time.monotonic()
        if now >= self._next_report:
            self._next_report = now + _REPORT_EVERY
            self._report(generation)

    def _report(self, generation: Generation) -> None:
        levels = self.method.wavelet_levels
        stage = f" level {self._stage.genome.basis.levels + 1} of {levels + 1}" if levels else ""
        found = self._stage.fitness.evaluate(self.runs[self._run].genes[None, :])
        done = min(1.0, self.history.generations / self.method.budget)
        self.session.progress.report(
            ProgressReport(
                f"search{stage}",
                self.history.generations,
                float(found.objective[0]),
                float(found.residual[0]),
                self.share * done,
                diversity=generation.diversity,
            )
        )
