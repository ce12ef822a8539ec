"""The search: runs from the guess, then finer functions stage after stage, watched."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solvers.errors import OndeletteError
from solvers.genetic.fitness import Evaluation, Fitness
from solvers.genetic.genome import Genome
from solvers.genetic.history import History
from solvers.genetic.islands import Islands
from solvers.genetic.run import Order, Population, adapt, evolve, run
from solvers.genetic.simulators import simulator_of
from solvers.genetic.stage import Stages
from solvers.optimizers.genetic import Generation
from solvers.progress import ProgressReport
from solvers.session import Session
from solvers.status import SolveStatus

Vector = NDArray[np.float64]

# The size of the first moves, in genes, from the answer of the stage before.
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
    """The best individual of a run: its genes (G,) and what they stand for.

    ``ended``: nobody has stopped the run; ``population``: its last one, where the next stage goes on with it.
    """

    genome: Genome
    genes: Vector
    fitness: float = np.inf
    ended: bool = False
    population: Population | None = None


@dataclass
class Search:
    """A search as it runs; ``runs`` are the best individuals of independent runs from the guess.

    ``starts``: so many runs at least; ``islands``, where runs are done side by side, gives their processes.
    ``deadline`` (of ``time.monotonic()``) ends the search; ``share``: the part of all work that it is.
    """

    session: Session
    stages: Stages
    starts: int
    islands: Callable[[], Islands] | None
    deadline: float
    share: float
    history: History = field(default_factory=History)
    runs: list[Found] = field(default_factory=list)
    stopped: SolveStatus | None = None

    def __post_init__(self) -> None:
        self.model, self.method = self.stages.model, self.stages.method
        self._next_report = 0.0

    @property
    def best(self) -> Found:
        """The best of all runs; a run that went on with finer functions is."""
        return min(self.runs, key=lambda run: (-run.genome.basis.levels, run.fitness))

    @property
    def budget(self) -> int:
        """All generations that there may be."""
        return self.method.budget(self.starts)

    def run(self) -> None:
        """Search; a search that is stopped keeps what it has. Raises what the session's progress raises."""
        try:
            self._stage = self.stages.at(0, self._pause)
            if self.islands is None:
                self._one_by_one()
            else:
                self._side_by_side(self.islands())
            self._run = self.runs.index(self.best)
            for levels in range(1, self.method.wavelet_levels + 1):
                self._refine(levels)
        except Stopped as stop:
            self.stopped = stop.status

    def judged(self, run: Found) -> Evaluation:
        """Objective, residual and violation of the best individual of a run, (1,) each."""
        stage = self._stage.fitness
        simulator = stage.simulator if run.genome is stage.genome else simulator_of(self.model, run.genome)
        return Fitness(self.model, run.genome, simulator, self.method.penalty).evaluate(run.genes[None, :])

    def _allowed(self, number: int) -> int:
        """How many generations a run may take after those that have ended; 0 where none is wanted any more.

        By the operators of the paper there are as many runs as starts; else the best has to be found twice,
        or no generations are left.
        """
        if self.method.variant == "classic":
            return self.method.generations if number < self.starts else 0
        if len(self.runs) >= self.starts and self._found_twice():
            return 0
        generations = self.method.generations
        return max(0, min(generations, self.starts * generations - self.history.generations))

    def _found_twice(self) -> bool:
        reached = sorted(run.fitness for run in self.runs)
        return len(reached) > 1 and reached[1] - reached[0] <= _SAME * abs(reached[0])

    def _one_by_one(self) -> None:
        genome = self._stage.genome
        while generations := self._allowed(len(self.runs)):
            self._run = len(self.runs)
            self.runs.append(Found(genome, genome.first()))
            population = run(self._stage, self.method, Order(self._run, generations), self._watch)
            self.runs[self._run] = replace(self.runs[self._run], ended=True, population=population)

    def _side_by_side(self, islands: Islands) -> None:
        """The same runs with the same answers; those that turn out not to be wanted are dropped."""
        with islands:
            try:
                while self._allowed(number := len(self.runs)):
                    while islands.may_begin(number) and (generations := self._allowed(len(islands.records))):
                        islands.order(Order(len(islands.records), generations))
                    islands.listen()
                    if islands.records[number].ended:
                        self._take(islands, number)
                    self._pause()
                    self._report_islands(islands)
            except Stopped:
                for number in range(len(self.runs), len(islands.records)):
                    if self._allowed(number):
                        self._take(islands, number)
                raise

    def _take(self, islands: Islands, number: int) -> None:
        """Take over what an island has told of a run, as far as it may go."""
        record, genome = islands.records[number], self._stage.genome
        fitness = record.fitness
        if self.method.variant == "modern":  # it may have begun when more generations were left
            fitness = fitness[: self._allowed(number)]
        genes, best = record.best(len(fitness)) or (genome.first(), np.inf)
        self.runs.append(Found(genome, genes, best, record.ended, record.population))
        for value in fitness:
            self.history.add(value)

    def _refine(self, levels: int) -> None:
        """The next stage: the best individuals with the genes of its wavelets, which start at zero.

        Generations that earlier stages have left are there for the next ones.
        """
        method, coarse, found = self.method, self._stage.genome, self.runs[self._run]
        self._stage = self.stages.at(levels, self._pause)
        stage = self._stage
        genes = coarse.extended(found.genes[None, :], stage.genome)
        self.runs[self._run] = Found(stage.genome, genes[0], float(stage.fitness(genes)[0]))
        if found.population is not None:
            population = replace(
                found.population, genes=coarse.extended(found.population.genes, stage.genome)
            )
            population = evolve(stage, method, population, method.refine_generations, self._watch)
            self.runs[self._run] = replace(self.runs[self._run], ended=True, population=population)
            return
        left = (self.budget - self.history.generations) // (method.wavelet_levels + 1 - levels)
        order = Order(len(self.runs) + levels - 1, left)
        adapt(stage, method, order, genes[0], _NEXT_SIGMA, self._watch)
        self.runs[self._run] = replace(self.runs[self._run], ended=True)

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
        if self._due():
            self._report(self.history.generations, self.runs[self._run].genes, generation.diversity)

    def _report_islands(self, islands: Islands) -> None:
        """Tell of the run that is to be taken next."""
        record = islands.records.get(len(self.runs))
        if record is not None and record.better and self._due():
            generations = self.history.generations + len(record.fitness)
            self._report(generations, record.better[-1][1], record.diversity)

    def _due(self) -> bool:
        now = time.monotonic()
        if now < self._next_report:
            return False
        self._next_report = now + _REPORT_EVERY
        return True

    def _report(self, generations: int, genes: Vector, diversity: float) -> None:
        levels = self.method.wavelet_levels
        stage = f" level {self._stage.genome.basis.levels + 1} of {levels + 1}" if levels else ""
        found = self._stage.fitness.evaluate(genes[None, :])
        self.session.progress.report(
            ProgressReport(
                f"search{stage}",
                generations,
                float(found.objective[0]),
                float(found.residual[0]),
                self.share * min(1.0, generations / self.budget),
                diversity=diversity,
            )
        )
