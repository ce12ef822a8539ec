"""Fly all runs of an answer, block after block."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from solvers.elastic import Wish, wishes_of
from solvers.errors import OndeletteError
from solvers.flights.block import Block, Flown
from solvers.flights.commands import commands_of
from solvers.flights.draws import Draws
from solvers.flights.model import dispersed_problem
from solvers.legs import routes, without_rates
from solvers.problem import OptimalControlProblem
from solvers.progress import Progress, ProgressReport
from solvers.scaling import automatic_scaling
from solvers.spec import JobSpec
from solvers.spec.flights import FlightsSpec
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory

# So many flights at once stay in the cache.
_BLOCK = 1024


class FlightsStopped(OndeletteError):
    """Nobody waits for the flights any more, or their time is over: ``status`` says which."""

    def __init__(self, status: SolveStatus) -> None:
        self.status = status
        super().__init__(status.sentence)


@dataclass(frozen=True)
class _Watch:
    """Tells how far a block is, and stops it."""

    progress: Progress
    deadline: float
    share: tuple[float, float]

    def __call__(self, part: float, steps: int) -> None:
        begin, end = self.share
        self.progress.report(ProgressReport("fly", steps, fraction=begin + part * (end - begin)))
        if self.progress.cancelled():
            raise FlightsStopped(SolveStatus.CANCELLED)
        if time.monotonic() > self.deadline:
            raise FlightsStopped(SolveStatus.TIME_LIMIT)


def fly(
    spec: FlightsSpec, job: JobSpec, answer: Trajectory, draws: Draws, progress: Progress, deadline: float
) -> list[Flown]:
    """Fly the answer to a job; every block has the undisturbed flight as its first.

    ``deadline`` is of ``time.monotonic()``. Raises FlightsStopped, and whatever the progress raises.
    """
    problem = dispersed_problem(job.problem, [*draws.parameters])
    actuators = [spec.actuator.get(name) for name in problem.controls]
    lags = np.array([0.0 if item is None else item.lag for item in actuators])
    (plant,) = routes(without_rates(job.problem), [answer])
    delays = {name: item.delay for name, item in spec.actuator.items()}
    commands = commands_of(plant.legs, spec.table(job), delays)
    limits = _limits(plant.legs[0].problem, rates_of(job))
    firsts = range(0, spec.runs, _BLOCK)
    flown = []
    for number, first in enumerate(firsts):
        watch = _Watch(progress, deadline, (number / len(firsts), (number + 1) / len(firsts)))
        block = Block(problem, answer, commands, lags, draws.part(first, first + _BLOCK), limits)
        flown.append(block.fly(spec.coast, watch, decay=spec.actuator_after == "decay"))
    return flown


def _limits(problem: OptimalControlProblem, rates: frozenset[str]) -> list[Wish]:
    """What flights may violate: not the bounds of controls, which the actuators keep, nor those of rates."""
    return [
        wish
        for wish in wishes_of(problem, automatic_scaling(problem))
        if not _of_control(wish, problem) and wish.limit.expression.names.isdisjoint(rates)
    ]


def _of_control(wish: Wish, problem: OptimalControlProblem) -> bool:
    _, section, *_, name = wish.limit.pointer.split("/")[1:]
    return section == "final_control" or (section == "bounds" and name in problem.controls)


def rates_of(job: JobSpec) -> frozenset[str]:
    """The rates of controls that expressions may name, which no table of commands has."""
    return frozenset(f"{name}_dot" for name in job.problem.control_rates)
