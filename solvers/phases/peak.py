"""The peak over a whole flight: one unknown, shared by all phases, that is nowhere exceeded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from solvers.backends import NUMPY
from solvers.expressions import Expression, named, total
from solvers.formulation.lifting import FLIGHT_PEAK, below_peak, lifted, peak_of_guess, with_peak
from solvers.phases.problem import PhasedProblem
from solvers.phases.trajectory import PhasedTrajectory
from solvers.problem import OptimalControlProblem
from solvers.verification.violations import clipped, dense


def flight_peak(plant: str = "") -> str:
    """The name of the unknown of a plant."""
    return FLIGHT_PEAK + plant


def with_flight_peak(flight: PhasedProblem) -> PhasedProblem:
    """What is solved for the flight of one plant: its peak cost is an unknown in the terminal cost."""
    if flight.peak_cost is None:
        return flight
    problems = below_flight_peak(
        [with_peak(phase.plant.problem) for phase in flight.phases], peaks_of(flight), flight_peak()
    )
    phases, exact = zip(flight.phases, problems, strict=True), flight.exact_integrals
    return replace(
        flight,
        phases=tuple(replace(phase, problem=lifted(problem, exact=exact)) for phase, problem in phases),
        design=(*flight.design, flight_peak()),
        terminal_cost=plus_peak(flight.terminal_cost, flight_peak()),
        peak_cost=None,
    )


def peaks_of(flight: PhasedProblem) -> list[Expression | None]:
    """The peak cost of the flight in each phase; None where a phase has a model of its own."""
    return [None if phase.view.has_own_model else flight.peak_cost for phase in flight.phases]


def below_flight_peak(
    problems: Sequence[OptimalControlProblem], peaks: Sequence[Expression | None], name: str
) -> list[OptimalControlProblem]:
    """The problems of phases whose peaks are below one unknown of this name."""
    pairs = list(zip(problems, peaks, strict=True))
    guess = max(peak_of_guess(problem, peak) for problem, peak in pairs if peak is not None)
    return [problem if peak is None else below_peak(problem, peak, name, guess) for problem, peak in pairs]


def plus_peak(terminal: Expression | None, name: str) -> Expression:
    """A terminal cost, and the unknown of a peak."""
    return total([*([] if terminal is None else [terminal]), named(name)])


def peak_along(flight: PhasedProblem, answer: PhasedTrajectory) -> float:
    """The peak cost of a flight as it was promised, with its controls clipped to their bounds; 0 without."""
    found = []
    for phase, part, peak in zip(flight.phases, answer.parts, peaks_of(flight), strict=True):
        if peak is not None:
            problem, tau = phase.plant.problem, dense(part.breakpoints)
            controls = clipped(part.controls_at(tau), problem.control_bounds)
            scope = problem.scope(
                part.states_at(tau), controls, part.time(tau), problem.parameters_of(part), NUMPY
            )
            found.append(np.max(peak.evaluate(scope, NUMPY.functions)))
    return float(max(found, default=0.0))
