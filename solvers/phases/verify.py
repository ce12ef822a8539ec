"""Independent verification of a flight of phases: every phase flown, then all of them through the jumps.

Knows nothing of the method that it checks. The whole flight begins as promised; each later phase begins with
what the link makes of the end to which the phases before were flown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.phases.peak import peak_along
from solvers.phases.problem import PhasedProblem, begin_after
from solvers.phases.trajectory import PhasedTrajectory
from solvers.trajectory import Trajectory
from solvers.verification.boundary import End, Scales, boundary_violation
from solvers.verification.verdict import Check, StateReport, Tolerances, Verification
from solvers.verification.verify import IMPLIED_ENDS, verify
from solvers.verification.violations import dense, scale_of, scaled_violation

Vector = NDArray[np.float64]

_LINK = "link"


def verify_phases(
    problem: PhasedProblem,
    answer: PhasedTrajectory,
    tolerances: Tolerances,
    deadline: float,
    implied: Mapping[str, float] | None = None,
) -> Verification:
    """Fly every phase and the whole flight; see :func:`solvers.verification.verify.verify`.

    ``implied``: of the end of the whole flight.

    The figures are the worst ones of all phases; besides, ``link`` compares the promised begin of each phase
    with what the link makes of the promised end before it.
    """
    parts: list[Verification] = []
    for index, (phase, trajectory) in enumerate(zip(problem.phases, answer.parts, strict=True)):
        begin = None
        if index and parts[-1].end is not None:
            begin = _states_after(problem, answer, index, parts[-1].end)
        own = implied if index == len(answer.parts) - 1 else None
        parts.append(verify(phase.plant.problem, trajectory, tolerances, deadline, begin, own))
    gaps = [_gap(problem, answer, index) for index in range(1, len(parts))]
    scope = flight_scope(problem, answer, parts)
    checks = [*_worst_checks(parts), Check(_LINK, max(gaps, default=0.0), tolerances.terminal_error)]
    whole = _whole_flight(problem, answer, parts)
    checks = [
        replace(check, value=max(check.value, whole))
        if check.name == "ends" and check.value is not None
        else check
        for check in checks
    ]
    return Verification(
        terminal_error=_worst([part.terminal_error for part in parts]),
        max_state_error=_worst([part.max_state_error for part in parts]),
        max_bound_violation=max(part.max_bound_violation for part in parts),
        max_path_violation=max(part.max_path_violation for part in parts),
        objective=_objective(problem, answer, parts, scope),
        integrals=totals([part.integrals for part in parts]),
        growth=None if any(part.growth is None for part in parts) else _product(parts),
        states={name: _state(name, parts) for name in problem.states},
        tolerances=tolerances,
        checks=tuple(checks),
        note=" ".join(
            f"{phase.name}: {part.note}"
            for phase, part in zip(problem.phases, parts, strict=True)
            if part.note
        ),
        end=parts[-1].end,
        parts=tuple(parts),
    )


def totals(integrals: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Integrals of all phases by name; those of one name add up."""
    names = dict.fromkeys(name for own in integrals for name in own)
    return {name: sum(own.get(name, 0.0) for own in integrals) for name in names}


def _states_after(problem: PhasedProblem, answer: PhasedTrajectory, index: int, end: Vector) -> Vector:
    """The states with which phase ``index`` begins after ``end``; as promised where they are free."""
    before, after = (phase.plant.problem for phase in problem.phases[index - 1 : index + 1])
    promised = answer.parts[index].states_at(np.zeros(1))[:, 0]
    return begin_after(problem.links[index - 1], before, answer.parts[index - 1], end, after, promised)


def _gap(problem: PhasedProblem, answer: PhasedTrajectory, index: int) -> float:
    """How far phase ``index`` begins, in time or state, from where it should, relative to scales."""
    before, after = answer.parts[index - 1 : index + 1]
    end = before.states_at(np.ones(1))[:, 0]
    wanted = _states_after(problem, answer, index, end)
    begin = after.states_at(np.zeros(1))
    late = abs(after.t0 - before.tf) / max(abs(answer.tf - answer.t0), 1e-6)
    scale = scale_of(after.states_at(dense(after.breakpoints)))
    return max(late, scaled_violation(begin, np.column_stack([wanted, wanted]), scale))


def flight_scope(
    problem: PhasedProblem, answer: PhasedTrajectory, parts: Sequence[Verification]
) -> dict[str, Any]:
    """Name both ends of the whole flight and its integrals; ``parts`` are the verifications of the phases."""
    return _scope(problem, answer, *_ends(answer, parts), _totals(problem, parts))


def _scope(
    problem: PhasedProblem, answer: PhasedTrajectory, initial: Any, final: Any, integrals: Any
) -> dict[str, Any]:
    last = problem.phases[-1].plant.problem.parameters_of(answer.parts[-1])
    parameters = {**problem.parameters, **answer.design}, last
    return problem.ends_scope(initial, final, parameters, NUMPY, integrals)


def _totals(problem: PhasedProblem, parts: Sequence[Verification]) -> Vector:
    sums = totals([part.integrals for part in parts])
    return np.array([sums.get(item.name, np.nan) for item in problem.totals])


def _ends(answer: PhasedTrajectory, parts: Sequence[Verification]) -> tuple[End, End]:
    return _end(answer.parts[0], 0.0, None), _end(answer.parts[-1], 1.0, parts[-1].end)


def _end(trajectory: Trajectory, tau: float, flown: Vector | None) -> tuple[Vector, Vector, float]:
    at = np.array([tau])
    states = trajectory.states_at(at)[:, 0] if flown is None else flown
    return states, trajectory.controls_at(at)[:, 0], float(trajectory.time(at)[0])


def _worst_checks(parts: Sequence[Verification]) -> Iterator[Check]:
    """The worst of the checks of each name; that of the end of the flight if every phase has it.

    Ends that are implied are those of the last phase.
    """
    for check in parts[0].checks:
        same = [own for part in parts for own in part.checks if own.name == check.name]
        if len(same) == len(parts):
            yield replace(check, value=_worst([own.value for own in same]))
    yield from (check for check in parts[-1].checks if check.name == IMPLIED_ENDS)


def _whole_flight(problem: PhasedProblem, answer: PhasedTrajectory, parts: Sequence[Verification]) -> float:
    """The largest violation of what the document says of the whole flight."""
    sums = _totals(problem, parts)
    bounds = np.array([item.interval for item in problem.totals])
    first, last = (_scales(part) for part in (answer.parts[0], answer.parts[-1]))
    ends = boundary_violation(
        problem.boundary, _ends(answer, parts), (first, last), sums, partial(_scope, problem, answer)
    )
    return max(ends, scaled_violation(sums[:, None], bounds, scale_of(sums[:, None])))


def _scales(part: Trajectory) -> Scales:
    tau = dense(part.breakpoints)
    return scale_of(part.states_at(tau)), scale_of(part.controls_at(tau))


def _objective(
    problem: PhasedProblem,
    answer: PhasedTrajectory,
    parts: Sequence[Verification],
    scope: Mapping[str, Any],
) -> float | None:
    costs = [part.objective for part in parts if part.objective is not None]
    if len(costs) < len(parts):
        return None
    with np.errstate(all="ignore"):
        terminal, peak = problem.terminal_cost, peak_along(problem, answer)
        return (
            sum(costs)
            + peak
            + (0.0 if terminal is None else float(terminal.evaluate(scope, NUMPY.functions)))
        )


def _state(name: str, parts: Sequence[Verification]) -> StateReport:
    """The largest error of a state in any phase, and its miss at the end of the last phase that has it."""
    own = [part.states[name] for part in parts if name in part.states]
    worst = max(own, key=lambda report: np.inf if report.max_error is None else report.max_error)
    return replace(worst, terminal_error=own[-1].terminal_error)


def _worst(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return max(known) if len(known) == len(values) else None


def _product(parts: Sequence[Verification]) -> float:
    return float(np.prod([part.growth for part in parts if part.growth is not None]))
