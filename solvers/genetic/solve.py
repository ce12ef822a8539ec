"""Solve a document by the genetic algorithm: search, polish, collocation, verification, judgement."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.certificate import hamiltonian_drift
from solvers.diagnosis import diagnose, sentence
from solvers.formulation.plants import Plant
from solvers.formulation.scenarios import Formulation
from solvers.genetic.answer import Simulation, fly, polish
from solvers.genetic.islands import Islands
from solvers.genetic.penalties import with_free_end
from solvers.genetic.residual import end_error, residual_check
from solvers.genetic.search import Search
from solvers.genetic.stage import Stages
from solvers.improve import first_methods, improvements
from solvers.improved import Improved
from solvers.judgement import judge, note_errors, verified
from solvers.meshes import meshes_of
from solvers.model_report import model_report
from solvers.output.report import constraint_margins
from solvers.phases.trajectory import AnyTrajectory
from solvers.refine.residual import mesh_error_estimate
from solvers.session import Session, statistics_of
from solvers.solution import PlantAnswer, Solution, Statistics
from solvers.solved import Solved
from solvers.spec import AutoMethod, GeneticMethod, JobSpec, ProblemSpec
from solvers.spec.places import place_in_document
from solvers.start.earlier import other_phases
from solvers.start.first_answer import first_answers
from solvers.status import SolveStatus
from solvers.switching import find_switching
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Verification

Vector = NDArray[np.float64]

# The parts of all work that are done after the search and after the polish where more follows.
_SEARCHED, _POLISHED = 0.8, 0.9
# The part of the time there is after which a search makes room for the polish.
_SEARCH_TIME = 0.7
_SENTENCES = {
    SolveStatus.CONVERGED: (
        "The search has ended and its own simulation is confirmed. End conditions are penalised, not met: "
        "see residual."
    ),
    SolveStatus.UNVERIFIED: (
        "The search has ended, but its answer is outside the verification tolerance. Let it be polished "
        "(method.polish), raise the penalty, or give it more generations."
    ),
}


@dataclass(frozen=True)
class _Answer:
    """What was reached by whatever came last: the search itself, or gradients after it."""

    trajectory: Trajectory
    objective: float
    integrals: Mapping[str, float]
    status: SolveStatus
    improved: Improved[Solved] | None = None
    costates: Vector | None = None
    """Known where gradients had the last word."""
    diagnosis: Sequence[Mapping[str, Any]] = ()


def solve_by_genes(
    spec: JobSpec,
    session: Session,
    method: GeneticMethod,
    earlier: AnyTrajectory | None,
    formulation: Formulation,
) -> Solution:
    """Solve a checked document whose method is genetic, and verify the answer.

    The problem of the session is the one that is simulated, of all plants at once. Raises what the progress
    of the session raises.
    """
    problem = session.problem
    search = _searched(spec, session, method, earlier)
    simulation = fly(search.model, search.best)
    session.convergence.append(
        {
            "level": 0,
            "nodes": int(simulation.trajectory.nodes.size),
            "objective": simulation.objective,
            "max_state_error": None,
        }
    )
    answer = _finished(session, spec.problem, method, search, simulation)
    improved = answer.improved
    residual = end_error(problem, answer.trajectory, answer.integrals)
    plants = [
        PlantAnswer(plant, plant.trajectory(answer.trajectory), _flown(spec, session, method, answer, plant))
        for plant in formulation.plants
    ]
    leading, trajectory = formulation.plants[0], plants[0].trajectory
    verification = _certified(session, method, answer, plants[0].verification, residual)
    plants[0] = replace(plants[0], verification=verification)
    note_errors(session, [own.verification for own in plants])
    sentences = _SENTENCES if method.ends_are_soft else {}
    status, message = judge(
        spec, leading.problem, trajectory, answer.status, verification, sentences, others=plants[1:]
    )
    integrals = leading.integrals(problem, answer.integrals, verification.integrals)
    warnings = [
        *other_phases(spec, earlier, session.parts),
        *_warnings(search, answer),
        *([] if improved is None else improved.warnings),
    ]
    costates = _no_costates(answer.trajectory) if answer.costates is None else answer.costates
    return Solution(
        spec=spec,
        problem=leading.problem,
        trajectory=trajectory,
        costates=costates[leading.rows(answer.trajectory)],
        objective=answer.objective,
        status=status,
        message=" ".join([message, *sentence(answer.diagnosis), *(item["detail"] for item in warnings)]),
        method={**method.model_dump(exclude_none=True), **_summary(method, improved)},
        verification=verification,
        model_report=model_report(leading.problem, trajectory),
        integrals=integrals,
        switching=(find_switching(problem, answer.trajectory) if improved is None else improved.switching[0]),
        constraints=constraint_margins(
            leading.problem,
            trajectory,
            integrals,
            lambda it: place_in_document(spec.problem, f"{it}@{leading.name}"),
        ),
        convergence=session.convergence,
        diagnosis=answer.diagnosis,
        starts=_runs(search),
        warnings=[*(formulation.warnings(problem) if method.goes_on else ()), *warnings],
        plants=() if spec.problem.scenarios is None else plants,
        statistics=_statistics(session, search, improved),
        extras={
            "energy": answer.objective,
            "penalty": method.penalty,
            "residual": residual,
            "fitness_history": search.history.values,
        },
    )


def _searched(
    spec: JobSpec, session: Session, method: GeneticMethod, earlier: AnyTrajectory | None
) -> Search:
    """A search that has come to its end; where more follows, it leaves time for that."""
    started, now = time.perf_counter(), time.monotonic()
    left = session.limits.deadline - now
    search = Search(
        session,
        Stages.of(session.problem, session.scaling, method, earlier),
        spec.options.starts,
        _islands(spec, method, earlier),
        now + (_SEARCH_TIME * left if method.goes_on else left),
        _SEARCHED if method.goes_on else 1.0,
    )
    search.run()
    session.iterations += search.history.generations
    session.seconds["solve"] += time.perf_counter() - started
    return search


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _islands(
    spec: JobSpec, method: GeneticMethod, earlier: AnyTrajectory | None
) -> Callable[[], Islands] | None:
    """What makes the processes of the runs; None where one after the other is as good.

    There are never more than runs or cores: with whatever number the answer is the same.
    """
    count = min(method.processes, cores())
    if method.variant == "classic":
        count = min(count, spec.options.starts)
    if count < 2:
        return None
    return lambda: Islands(spec.resolved().document, earlier, count)


def _finished(
    session: Session, spec: ProblemSpec, method: GeneticMethod, search: Search, simulation: Simulation
) -> _Answer:
    """The answer after everything that the method asks for; less where it is stopped or fails before."""
    status = session.stop if search.stopped is not None else None
    if status is None:
        status = SolveStatus.CONVERGED if search.stopped is None or method.goes_on else search.stopped
    if not np.isfinite(search.best.fitness):
        status = status if search.stopped is not None else SolveStatus.EVALUATION_ERROR
    answer = _Answer(simulation.trajectory, simulation.objective, simulation.integrals, status)
    if method.polish and answer.status is SolveStatus.CONVERGED:
        end = 1.0 if method.refine is None else _POLISHED
        residual = end_error(session.problem, answer.trajectory, answer.integrals)
        share = _SEARCHED, end
        solved = polish(session, method, search.best, answer.trajectory, residual, share)
        solved, diagnosis = diagnose(
            session, lambda _, pointer: place_in_document(spec, pointer), solved, span=end
        )
        answer = replace(_reached(Improved(solved)), diagnosis=diagnosis)
        if method.polish == "penalty":
            residual = end_error(session.problem, answer.trajectory, answer.integrals)
            answer = replace(answer, objective=answer.objective - method.penalty * residual**2)
    if method.refine is not None and answer.status is SolveStatus.CONVERGED:
        auto = AutoMethod(name="auto")
        used = first_methods(auto)[0]
        first = first_answers(session, meshes_of(used), 1, answer.trajectory, _POLISHED)[0]
        answer = _reached(next(improvements(session, auto, used, first, _POLISHED)))
    return answer


def _reached(improved: Improved[Solved]) -> _Answer:
    solved = improved.solved
    return _Answer(
        solved.trajectory,
        solved.objective,
        solved.transcription.integrals(solved.outcome.unknowns),
        solved.outcome.status,
        improved,
        solved.costates,
    )


def _flown(
    spec: JobSpec, session: Session, method: GeneticMethod, answer: _Answer, plant: Plant
) -> Verification:
    """The flight of a plant; ends that are soft are no conditions of it."""
    if method.ends_are_soft:
        plant = replace(plant, problem=with_free_end(plant.problem), implied={})
    return verified(session, spec, plant.trajectory(answer.trajectory), answer.status, plant)


def _certified(
    session: Session, method: GeneticMethod, answer: _Answer, verification: Verification, residual: float
) -> Verification:
    """The verification of the leading plant, with what is known of the whole; soft ends have a limit too."""
    if method.ends_are_soft:
        check = residual_check(residual, answer.trajectory, verification.tolerances.terminal_error)
        verification = replace(verification, checks=(check, *verification.checks))
    if answer.improved is None or answer.costates is None:
        return verification
    estimate = mesh_error_estimate(session.problem, answer.trajectory)
    verification = replace(verification, mesh_error_estimate=estimate)
    if method.refine is None:  # a control that is held in a basis does not minimise the Hamiltonian
        return verification
    weighted = answer.improved.solved.weighted_problem
    drift = hamiltonian_drift(weighted, answer.trajectory, answer.costates)
    return answer.improved.certified(replace(verification, hamiltonian_drift=drift))


def _no_costates(trajectory: Trajectory) -> Vector:
    return np.full((len(trajectory.states), trajectory.nodes.size), np.nan)


def _summary(method: GeneticMethod, improved: Improved[Solved] | None) -> dict[str, Any]:
    """What collocation did."""
    if method.refine is None or improved is None:
        return {}
    return {"collocation": {**AutoMethod(name="auto").model_dump(), **improved.summary}}


def _warnings(search: Search, answer: _Answer) -> list[dict[str, str]]:
    if search.stopped is None or answer.improved is None:
        return []
    spent = search.history.generations
    detail = f"The search was cut short after {spent} generations to leave time for the polish."
    return [{"code": "search_cut_short", "pointer": "/options/max_seconds", "detail": detail}]


def _runs(search: Search) -> list[dict[str, Any]]:
    best = search.best
    cut_short = SolveStatus.CONVERGED if search.stopped is None else search.stopped
    reports = []
    for run in search.runs:
        found = search.judged(run)
        reports.append(
            {
                "objective": float(found.objective[0]),
                "final_time": float(run.genome.read(run.genes[None, :]).tf[0]),
                "status": (SolveStatus.CONVERGED if run.ended else cut_short).value,
                "kept": run is best,
            }
        )
    return reports


def _statistics(session: Session, search: Search, improved: Improved[Solved] | None) -> Statistics:
    if improved is None:
        return Statistics(
            search.best.genome.size, 0, session.iterations, None, session.seconds, nlp_solver=None
        )
    return statistics_of(improved.solved, session)
