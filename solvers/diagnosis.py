"""Why no feasible point was found: which limits of the document stand against each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from solvers.elastic import Wish, elastic_problem, place_in_document, wishes_of
from solvers.meshes import Mesh
from solvers.problem import OptimalControlProblem
from solvers.session import Session, Solved
from solvers.spec import ProblemSpec
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription

# Slacks up to this part of their scale are what the tolerance of a program leaves.
_NOTHING = 1e-6
# What gives by more than this on a coarse mesh does so on a fine one as well, most probably.
_CLEARLY = 1e-2
# A contradiction may also end a solve in other ways.
_UNDECIDED = (SolveStatus.INFEASIBLE, SolveStatus.ITERATION_LIMIT, SolveStatus.DIVERGED)


def diagnose(
    session: Session, spec: ProblemSpec, solved: Solved, finest: Mesh | None = None, span: float = 1.0
) -> tuple[Solved, list[dict[str, Any]]]:
    """Find out what stands against an answer that did not converge, by an elastic re-solve on its mesh.

    ``finest``: the mesh that is asked for, where the answer is of a coarser one. What has to give there by
    more than coarse meshes err is solved for again on the finest mesh, which has the last word; otherwise the
    finest mesh is solved as if nothing had been found.

    Where limits have to give, the answer comes back as ``infeasible``, with the ``diagnosis`` of the result:
    ``pointer`` into the document, ``name``, ``violation`` in its own units, ``at``, the time at which that is
    reached (None where it belongs to none), and the ``scenario`` where there are several plants; what has to
    give most, compared with its scale, comes first.
    Where none has to give, the elastic answer is a feasible point, and the problem is solved again from it.
    Where the elastic problem is not solved either, the answer comes back as it was.
    ``span``: the part of all work that is done. Raises whatever the progress of the session raises.
    """
    problem, scaling = solved.transcription.problem, solved.transcription.scaling
    wishes = wishes_of(problem, scaling)
    if solved.outcome.status not in _UNDECIDED or session.stop is not None or not wishes:
        return solved, []
    asked = solved.transcription if finest is None else finest(problem, scaling, solved.transcription.start)
    relaxed = _relaxed(session, solved.transcription, wishes, span)
    if asked.mesh != solved.transcription.mesh and not relaxed.stopped:
        if not (relaxed.converged and _gives(wishes, relaxed.trajectory, _CLEARLY)):
            return diagnose(session, spec, session.solve(asked, "solve", (span, span)), span=span)
        asked = replace(asked, start=relaxed.trajectory)
        relaxed = _relaxed(session, asked, wishes, span, warm=True)
    if relaxed.outcome.status is SolveStatus.CANCELLED:
        return replace(solved, outcome=replace(solved.outcome, status=SolveStatus.CANCELLED)), []
    if not relaxed.converged:
        return solved, []
    found = _report(problem, spec, _gives(wishes, relaxed.trajectory, _NOTHING), relaxed.trajectory)
    if found:
        return replace(solved, outcome=replace(solved.outcome, status=SolveStatus.INFEASIBLE)), found
    again = replace(asked, start=relaxed.trajectory)
    answer = session.solve(again, "solve from a feasible point", (span, span), warm=True)
    return (answer if answer.converged or answer.stopped else solved), []


def _relaxed(
    session: Session, asked: Transcription, wishes: Sequence[Wish], span: float, *, warm: bool = False
) -> Solved:
    """The elastic problem on the mesh of a transcription and from its start, which is no level of the answer.

    ``warm``: the start is an elastic answer, which has the slacks too.
    """
    start, scaling = asked.start, asked.scaling
    elastic = replace(
        asked,
        problem=elastic_problem(asked.problem, wishes, start),
        scaling=replace(scaling, design=np.append(scaling.design, [wish.scale for wish in wishes])),
    )
    aside = replace(session, convergence=[])
    relaxed = aside.solve(elastic, "diagnose", (span, span), warm=warm)
    session.iterations = aside.iterations
    return relaxed


def _gives(wishes: Sequence[Wish], trajectory: Trajectory, least: float) -> list[Wish]:
    """What gives by more than the part ``least`` of its scale."""
    return [wish for wish in wishes if trajectory.design[wish.slack] > least * wish.scale]


def sentence(diagnosis: Sequence[Mapping[str, Any]]) -> list[str]:
    """What would have to give, for the message of a result; nothing where nothing has to."""
    if not diagnosis:
        return []
    gives = [f"{_label(item)} by {item['violation']:.4g}" for item in diagnosis]
    return [f"The least that would have to give, the dynamics kept exactly: {'; '.join(gives)}."]


def _label(item: Mapping[str, Any]) -> str:
    """The pointer, and the name where that says more."""
    pointer, name = item["pointer"], item["name"]
    label = pointer if pointer.endswith(f"/{name}") else f"{pointer} ('{name}')"
    return f"{label} of '{item['scenario']}'" if "scenario" in item else str(label)


def _report(
    problem: OptimalControlProblem, spec: ProblemSpec, giving: Sequence[Wish], trajectory: Trajectory
) -> list[dict[str, Any]]:
    slacks = trajectory.design
    giving = sorted(giving, key=lambda wish: -slacks[wish.slack] / wish.scale)
    return [
        {
            "pointer": place_in_document(spec, wish.limit.pointer),
            "name": wish.limit.name.partition("@")[0],
            "violation": slacks[wish.slack],
            "at": _time(problem, wish, trajectory),
            **({"scenario": case} if (case := wish.limit.pointer.partition("@")[2]) else {}),
        }
        for wish in giving
    ]


def _time(problem: OptimalControlProblem, wish: Wish, trajectory: Trajectory) -> float | None:
    """When a limit has to give most."""
    if not wish.along:
        at_the_end = wish.limit.pointer.startswith("/problem/final_")
        return trajectory.tf if at_the_end else None
    tau = trajectory.nodes
    return float(trajectory.time(tau)[np.argmax(wish.excess(problem, trajectory, tau))])
