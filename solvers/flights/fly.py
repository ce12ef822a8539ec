"""Fly all runs of an answer, block after block."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from solvers.errors import OndeletteError
from solvers.flights.chain import Plan, fly_plan
from solvers.flights.commands import commands_of
from solvers.flights.draws import Draws
from solvers.flights.flown import Flown
from solvers.flights.model import dispersed
from solvers.formulation.elastic import Wish, wishes_of, wishes_over_all
from solvers.phases.trajectory import AnyTrajectory
from solvers.problem import OptimalControlProblem
from solvers.progress import Progress, ProgressReport
from solvers.spec import JobSpec
from solvers.spec.flights import FlightsSpec
from solvers.spec.pointers import parse_pointer
from solvers.start.scaling import automatic_scaling
from solvers.status import SolveStatus
from solvers.verification.flight import FlightError
from solvers.verification.legs import rates_of, routes, without_rates

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
    span: tuple[float, float]
    share: tuple[float, float]

    def __call__(self, t: float, steps: int) -> None:
        begin, end = self.share
        part = (t - self.span[0]) / (self.span[1] - self.span[0])
        self.progress.report(ProgressReport("fly", steps, fraction=begin + part * (end - begin)))
        if self.progress.cancelled():
            raise FlightsStopped(SolveStatus.CANCELLED)
        if time.monotonic() > self.deadline:
            raise FlightsStopped(SolveStatus.TIME_LIMIT)


def fly(
    spec: FlightsSpec, job: JobSpec, answer: AnyTrajectory, draws: Draws, progress: Progress, deadline: float
) -> list[Flown]:
    """Fly the answer to a job; every block has the undisturbed flight as its first.

    ``deadline`` is of ``time.monotonic()``. Raises FlightsStopped, FlightError where an iterate is no flight,
    and whatever the progress raises.
    """
    plan = _plan(spec, job, answer)
    begin, end = plan.commands.start, plan.commands.end + (spec.coast or 0.0)
    firsts = range(0, spec.runs, _BLOCK)
    flown = []
    for number, first in enumerate(firsts):
        share = number / len(firsts), (number + 1) / len(firsts)
        watch = _Watch(progress, deadline, (begin, end), share)
        part = draws.part(first, first + _BLOCK)
        flown.append(fly_plan(plan, part, spec.coast, watch, decay=spec.actuator_after == "decay"))
    return flown


def _plan(spec: FlightsSpec, job: JobSpec, answer: AnyTrajectory) -> Plan:
    """What is flown of an answer."""
    (route,) = routes(without_rates(job.problem), [answer])
    times = [time for leg in route.legs for time in (leg.answer.t0, leg.answer.tf)]
    if not (np.diff(times)[::2] > 0.0).all() or not (np.diff(times[::2]) > 0.0).all():
        raise FlightError("a phase of the answer does not end after its begin")
    delays = {name: item.delay for name, item in spec.actuator.items()}
    rates = rates_of(job.problem)
    return Plan(
        job.problem,
        replace(route, legs=tuple(dispersed(leg, [*spec.parameters]) for leg in route.legs)),
        commands_of(route.legs, spec.table(job), delays),
        {name: item.lag for name, item in spec.actuator.items()},
        [_limits(leg.problem, rates) for leg in route.legs],
        [] if route.whole is None else wishes_over_all(route.whole.totals, route.whole.boundary),
    )


def _limits(problem: OptimalControlProblem, rates: frozenset[str]) -> list[Wish]:
    """What flights may violate: not the bounds of controls, which the actuators keep, nor those of rates."""
    return [
        wish
        for wish in wishes_of(problem, automatic_scaling(problem))
        if not _of_control(wish, problem) and wish.limit.expression.names.isdisjoint(rates)
    ]


def _of_control(wish: Wish, problem: OptimalControlProblem) -> bool:
    path = parse_pointer(wish.limit.pointer)
    return path[1] == "final_control" or (path[1] == "bounds" and path[-1] in problem.controls)
