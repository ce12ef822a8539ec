"""Solve a document with phases: first answer, verification through the jumps, judgement."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.diagnosis import sentence
from solvers.errors import Fault
from solvers.formulation.time_knots import tables_that_end
from solvers.improved import Improved
from solvers.judgement import fault_along, flown_in_time, judged, note_errors, sentences_of
from solvers.model_report import model_report
from solvers.optimizers.outcome import Limits
from solvers.output.report import constraint_margins, margins_of, merged_margins, said_of_the_ends
from solvers.phases.problem import PhasedProblem
from solvers.phases.scenarios import FlightPlant, formulate_phases
from solvers.phases.session import PhasedSession, PhasedSolved
from solvers.phases.solution import FlightAnswer, PhasedSolution
from solvers.phases.switching import joined_switching
from solvers.phases.trajectory import AnyTrajectory, PhasedTrajectory
from solvers.phases.verify import flight_scope, totals, verify_phases
from solvers.progress import Progress
from solvers.reach import reach
from solvers.sensitivity import Varied, numbers_of, sensitivity
from solvers.session import start_report, statistics_of
from solvers.spec import JobSpec, ProblemSpec
from solvers.spec.places import place_in_document
from solvers.start.earlier import other_phases
from solvers.start.scaling import automatic_scaling
from solvers.verification.evaluation_fault import Where
from solvers.verification.verdict import Verification

Vector = NDArray[np.float64]


def solve_phases(
    spec: JobSpec, progress: Progress, seconds: float, earlier: AnyTrajectory | None = None
) -> PhasedSolution:
    """Solve a checked document with phases and verify the answer; see :func:`solvers.solve.solve`."""
    started = time.perf_counter()
    allowed = spec.implied_tolerance()
    formulation = formulate_phases(spec.problem, allowed)
    session = PhasedSession(
        problem=formulation.problem,
        scaling=[automatic_scaling(phase.problem) for phase in formulation.problem.phases],
        tolerance=spec.options.tolerance,
        max_iterations=spec.options.max_iterations,
        limits=Limits(time.monotonic() + seconds, progress.cancelled),
        progress=progress,
    )
    session.seconds["build"] = time.perf_counter() - started

    def fly(improved: Improved[PhasedSolved]) -> list[FlightAnswer]:
        plants = [_flown(session, spec, improved.solved, plant) for plant in formulation.plants]
        plants[0] = replace(plants[0], verification=_certified(improved, plants[0].verification))
        return plants

    reached = reach(session, spec, earlier, formulation.problem.place, fly)
    improved, answers, diagnosis = reached.improved, reached.answers, reached.diagnosis
    solved, plants = improved.solved, reached.flights
    note_errors(session, [own.verification for own in plants])
    leading, problem, answer = plants[0].plant, plants[0].plant.problem, plants[0].trajectory
    verification = plants[0].verification
    flights = [("" if own is plants[0] else f"{own.plant.name}: ", own.verification) for own in plants]
    status, message = judged(
        solved.outcome.status,
        flights,
        lambda where: _evaluation_fault(problem, answer, where),
        sentences_of(spec),
    )
    integrals = [
        plant.integrals(
            part.transcription.problem, part.transcription.integrals(part.outcome.unknowns), flown.integrals
        )
        for plant, part, flown in zip(leading.parts, solved.parts, verification.parts, strict=True)
    ]
    reports = [
        model_report(phase.plant.problem, part)
        for phase, part in zip(problem.phases, answer.parts, strict=True)
    ]
    pairs = zip(problem.phases, answer.parts, strict=True)
    ended = [item for phase, part in pairs for item in tables_that_end(phase.plant.problem, part)]
    warnings = [*other_phases(spec, earlier, session.parts), *ended, *improved.warnings]
    one_plant = spec.problem.scenarios is None
    slopes = None
    if solved.converged:
        varied = _varied(spec.problem, problem)
        slopes = sensitivity(spec.problem, solved, varied, lambda it: formulate_phases(it, allowed).problem)
    solution = PhasedSolution(
        spec=spec,
        problem=problem,
        trajectory=answer,
        costates=[
            part.costates[plant.rows(part.trajectory)]
            for part, plant in zip(solved.parts, leading.parts, strict=True)
        ],
        objective=solved.objective,
        status=status,
        message=" ".join([message, *sentence(diagnosis), *(item["detail"] for item in warnings)]),
        method={**reached.method.model_dump(exclude_none=True), **improved.summary},
        verification=verification,
        model_report=_ends_of(reports),
        model_reports=reports,
        integrals=totals(integrals),
        integrals_by_phase=integrals,
        switching=joined_switching(
            improved.switching,
            [phase.plant.problem.controls for phase in problem.phases],
            answer.edges[1:].tolist(),
        ),
        constraints=plants[0].constraints,
        sensitivity=slopes,
        convergence=session.convergence,
        starts=[start_report(item, item.trajectory.tf, kept=item is answers[0]) for item in answers],
        warnings=[*formulation.warnings, *_empty(problem, solved), *warnings],
        plants=() if one_plant else plants,
        diagnosis=diagnosis,
        statistics=statistics_of(solved, session),
    )
    session.seconds["total"] = time.perf_counter() - started
    return solution


def _flown(session: PhasedSession, spec: JobSpec, solved: PhasedSolved, plant: FlightPlant) -> FlightAnswer:
    """The answer of one plant, flown on the plant itself."""
    answer = plant.trajectory(solved.trajectory)
    verification = flown_in_time(
        session,
        spec,
        solved.outcome.status,
        lambda limits, end: verify_phases(plant.problem, answer, limits, end, plant.parts[-1].implied),
    )
    margins = [
        {**item, "pointer": _said_at(spec.problem, item["pointer"], plant.name)}
        for item in _margins(plant.problem, answer, verification.parts)
    ]
    return FlightAnswer(plant, answer, verification, margins)


def _said_at(spec: ProblemSpec, pointer: str, case: str) -> str:
    """Where stands what counts over the whole flight of a case, which never says anything of a phase."""
    return pointer if pointer.startswith("/problem/phases/") else place_in_document(spec, f"{pointer}@{case}")


def _empty(problem: PhasedProblem, solved: PhasedSolved) -> Iterator[dict[str, str]]:
    for index in solved.empty_parts:
        detail = (
            f"The phase '{problem.phases[index].name}' takes next to no time, so that nothing depends on its"
            " controls: that may be no optimum. Guess its final_time, or give it a point or a cost."
        )
        yield {"code": "empty_phase", "pointer": f"/problem/phases/{index}", "detail": detail}


def _certified(improved: Improved[PhasedSolved], verification: Verification) -> Verification:
    """The verification with the Hamiltonian of every phase and the errors of its mesh, worst first."""
    drifts = [part.hamiltonian_drift for part in improved.solved.parts]
    errors = improved.mesh_errors
    parts = tuple(
        replace(part, hamiltonian_drift=drift, mesh_error_estimate=error)
        for part, drift, error in zip(verification.parts, drifts, errors, strict=True)
    )
    known = [drift for drift in drifts if drift is not None]
    estimates = [error for error in errors if error is not None]
    whole = replace(
        verification,
        parts=parts,
        hamiltonian_drift=max(known, default=None),
        mesh_error_estimate=max(estimates) if len(estimates) == len(errors) else None,
    )
    return improved.certified(whole)


def _evaluation_fault(problem: PhasedProblem, answer: PhasedTrajectory, where: Where) -> Fault | None:
    for phase, part in zip(problem.phases, answer.parts, strict=True):
        fault = fault_along(phase.spec, phase.plant.problem, part, where)
        if fault is not None:
            return replace(fault, pointer=phase.located(fault.pointer))
    return None


def _ends_of(reports: Sequence[Mapping[str, Any] | None]) -> dict[str, Any] | None:
    """The ``model_report`` at the begin of the first and at the end of the last phase."""
    first, last = reports[0], reports[-1]
    return None if first is None or last is None else {"initial": first["initial"], "final": last["final"]}


def _margins(
    problem: PhasedProblem, answer: PhasedTrajectory, parts: Sequence[Verification]
) -> list[dict[str, Any]]:
    """The ``constraints`` of all phases and of the whole flight; what holds in several stands there once."""
    own = (
        {**item, "pointer": phase.place(item["pointer"])}
        for phase, part, flown in zip(problem.phases, answer.parts, parts, strict=True)
        for item in constraint_margins(phase.plant.problem, part, flown.integrals, str)
        if phase.says(item["pointer"])
    )
    scope = flight_scope(problem, answer, parts)
    whole = margins_of(said_of_the_ends(problem.boundary, problem.totals, scope, answer.tf))
    return merged_margins(chain(own, whole))


def _varied(spec: ProblemSpec, problem: PhasedProblem) -> Iterator[Varied]:
    """Every number beside the phases and in each of them."""
    common = {name: spec.model.parameters[name] for name in problem.parameters}
    yield from numbers_of(spec, common, spec.model.parameter_values())
    for index, (phase, own) in enumerate(zip(problem.phases, spec.phases, strict=True)):
        parameters, here = phase.plant.problem.parameters, ("phases", index)
        for name, value in own.parameters.items():
            yield Varied((*here, "parameters", name), value, parameters)
        for item in numbers_of(own, parameters if phase.view.has_own_model else {}, parameters):
            yield item._replace(place=(*here, *item.place))
