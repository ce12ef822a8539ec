"""Solve a document: first answer, improvement, verification, judgement."""

from __future__ import annotations

import math
import time
from dataclasses import replace

from solvers.diagnosis import sentence
from solvers.errors import DocumentError, Fault
from solvers.formulation.scenarios import Formulation, formulate
from solvers.formulation.time_knots import tables_that_end
from solvers.genetic.solve import solve_by_genes
from solvers.improve import other_structures
from solvers.improved import Improved
from solvers.judgement import judge, note_errors, verified
from solvers.model_report import model_report
from solvers.optimizers.outcome import Limits
from solvers.output.report import constraint_margins
from solvers.phases.solution import PhasedSolution
from solvers.phases.solve import solve_phases
from solvers.phases.trajectory import AnyTrajectory
from solvers.piecewise.solve import solve_piecewise
from solvers.problem import OptimalControlProblem
from solvers.progress import Progress, SilentProgress
from solvers.reach import reach, shortfall
from solvers.sensitivity import numbers_of, sensitivity
from solvers.session import Session, start_report, statistics_of
from solvers.solution import PlantAnswer, Solution
from solvers.solved import Solved
from solvers.spec import GeneticMethod, JobSpec, PiecewiseMethod
from solvers.spec.places import place_in_document
from solvers.start.earlier import other_phases
from solvers.start.scaling import automatic_scaling


def solve(
    spec: JobSpec,
    progress: Progress | None = None,
    earlier: AnyTrajectory | None = None,
    seconds: float = math.inf,
) -> Solution | PhasedSolution:
    """Solve a checked document and verify the answer.

    ``earlier`` is the answer of the job that the document names in ``warm_start``; ``seconds`` is the time
    there is, where that is less than the document's ``max_seconds``. Never raises for a
    numerical failure: the last iterate comes back with its status. Raises DocumentError if ``warm_start`` is
    given without an ``earlier`` answer, and what ``progress`` raises.
    """
    if spec.warm_start is not None and earlier is None:
        detail = "there is no earlier job to start from here; guess.from_result takes the nodes of a result"
        raise DocumentError([Fault("/warm_start", detail)])
    if spec.problem.phases:
        return solve_phases(
            spec, progress or SilentProgress(), min(spec.options.max_seconds, seconds), earlier
        )
    if isinstance(spec.method, PiecewiseMethod):
        return solve_piecewise(spec, progress or SilentProgress(), min(spec.options.max_seconds, seconds))
    started = time.perf_counter()
    allowed = spec.implied_tolerance()
    formulation = formulate(spec.problem, allowed)
    seconds = min(spec.options.max_seconds, seconds)
    if isinstance(spec.method, GeneticMethod):
        formulation = formulation.as_simulated()
    problem = formulation.problem
    session = _session(spec, problem, progress or SilentProgress(), seconds)
    session.seconds["build"] = time.perf_counter() - started
    if isinstance(spec.method, GeneticMethod):
        solution = solve_by_genes(spec, session, spec.method, earlier, formulation)
        session.seconds["total"] = time.perf_counter() - started
        return solution

    if earlier is not None:
        earlier = formulation.plants[0].solved_from(earlier)

    def place(_: int, pointer: str) -> str:
        return place_in_document(spec.problem, pointer)

    def fly(improved: Improved[Solved]) -> list[PlantAnswer]:
        return _flown(session, spec, formulation, improved)

    reached = reach(session, spec, earlier, place, fly)
    answers, method, diagnosis = reached.answers, reached.method, reached.diagnosis
    improved, extremals = other_structures(session, reached.improved, spec.options.starts - 1)
    plants = reached.flights if improved is reached.improved else fly(improved)
    if shortfall(plants) > 1.0 >= shortfall(reached.flights):
        improved, plants = reached.improved, reached.flights
    note_errors(session, [own.verification for own in plants])
    solved = improved.solved
    leading, trajectory, verification = plants[0].plant, plants[0].trajectory, plants[0].verification
    status, message = judge(
        spec, leading.problem, trajectory, solved.outcome.status, verification, others=plants[1:]
    )
    integrals = leading.integrals(
        problem, solved.transcription.integrals(solved.outcome.unknowns), verification.integrals
    )
    one_plant = spec.problem.scenarios is None
    warnings = [
        *other_phases(spec, earlier, session.parts),
        *tables_that_end(problem, trajectory),
        *improved.warnings,
    ]
    slopes = None
    if solved.converged:
        model = spec.problem.model
        parameters = {name: model.parameters[name] for name in leading.problem.parameters}
        varied = numbers_of(spec.problem, parameters, model.parameter_values())
        slopes = sensitivity(
            spec.problem, solved, varied, lambda it: formulate(it, allowed, formulation).problem
        )
    solution = Solution(
        spec=spec,
        problem=leading.problem,
        trajectory=trajectory,
        costates=solved.costates[leading.rows(solved.trajectory)],
        objective=solved.objective,
        status=status,
        message=" ".join([message, *sentence(diagnosis), *(item["detail"] for item in warnings)]),
        method={**method.model_dump(exclude_none=True), **improved.summary},
        verification=verification,
        model_report=model_report(leading.problem, trajectory),
        integrals=integrals,
        switching=leading.switching(improved.switching[0]),
        constraints=constraint_margins(
            leading.problem, trajectory, integrals, lambda it: place(0, f"{it}@{leading.name}")
        ),
        sensitivity=slopes,
        convergence=session.convergence,
        starts=[
            *(start_report(item, item.trajectory.tf, kept=item is answers[0]) for item in answers),
            *(item.report(problem) for item in extremals),
        ],
        warnings=[*formulation.warnings(problem), *warnings],
        plants=() if one_plant else plants,
        diagnosis=diagnosis,
        statistics=statistics_of(solved, session),
    )
    session.seconds["total"] = time.perf_counter() - started
    return solution


def _flown(
    session: Session, spec: JobSpec, formulation: Formulation, improved: Improved[Solved]
) -> list[PlantAnswer]:
    """An answer flown on every plant, with what else is known of it said of the leading one."""
    solved = improved.solved
    plants = [
        PlantAnswer(
            plant,
            trajectory := plant.trajectory(solved.trajectory),
            verified(session, spec, trajectory, solved.outcome.status, plant),
        )
        for plant in formulation.plants
    ]
    verification = replace(
        plants[0].verification,
        hamiltonian_drift=solved.hamiltonian_drift,
        mesh_error_estimate=improved.mesh_errors[0],
    )
    plants[0] = replace(plants[0], verification=improved.certified(verification))
    return plants


def _session(spec: JobSpec, problem: OptimalControlProblem, progress: Progress, seconds: float) -> Session:
    return Session(
        problem=problem,
        scaling=automatic_scaling(problem),
        tolerance=spec.options.tolerance,
        max_iterations=spec.options.max_iterations,
        limits=Limits(time.monotonic() + seconds, progress.cancelled),
        progress=progress,
    )
