"""The first answer to a problem: from an earlier job, or from one or several starts, from coarse to fine.

A start is one for each part of what is solved together: for each phase, or the only one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from solvers.meshes import Mesh
from solvers.phases.trajectory import AnyTrajectory
from solvers.session import Solving
from solvers.solved import Ended, Stand
from solvers.start.earlier import starts_from
from solvers.start.guess import Start
from solvers.start.minimum_energy import CubicStart, minimum_energy_start
from solvers.start.starts import moved_start, several_starts
from solvers.start.winding import unwound
from solvers.status import SolveStatus
from solvers.transcription.base import Transcription

Starts = Sequence[Start]
"""A start for each part."""


def first_answers(
    session: Solving[Ended],
    meshes: Sequence[Mesh],
    starts: int,
    earlier: AnyTrajectory | None,
    span: float,
) -> list[Ended]:
    """Answers on the finest mesh, best first: one for each start, or the one that ``earlier`` leads to.

    ``span``: the part of all work that this is. Raises whatever the progress of the session raises.
    """
    answers = _from_earlier(session, meshes, earlier, span) or _from_starts(session, meshes, starts, span)
    return sorted(answers, key=_rank)


def _rank(answer: Stand[Any, Any]) -> tuple[bool, float]:
    """Converged answers first, then the smallest objective."""
    return not answer.converged, answer.objective if np.isfinite(answer.objective) else np.inf


def _on(session: Solving[Ended], mesh: Mesh, starts: Starts) -> list[Transcription]:
    """Every part on the same mesh, from a start of its own."""
    return [
        mesh(part.problem, part.scaling, start) for part, start in zip(session.parts, starts, strict=True)
    ]


def _from_earlier(
    session: Solving[Ended], meshes: Sequence[Mesh], earlier: AnyTrajectory | None, span: float
) -> list[Ended]:
    """The finest mesh solved from an earlier answer; nothing if there is none or it leads nowhere."""
    if earlier is None:
        return []
    transcriptions = _on(session, meshes[-1], starts_from(earlier, session.parts))
    solved = session.solve_parts(transcriptions, "solve from the earlier job", (0.0, span), warm=True)
    return [solved] if solved.converged or solved.stopped else []


def _from_starts(session: Solving[Ended], meshes: Sequence[Mesh], count: int, span: float) -> list[Ended]:
    """An answer from each start, ``span`` of all work; fewer if somebody or the clock asks to stop."""
    answers: list[Ended] = []
    for index, starts in enumerate(_starts(session, count)):
        stage = "solve" if count == 1 else f"start {index + 1} of {count}"
        share = span * index / count, span * (index + 1) / count
        # Where nothing else is tried, why a coarse mesh has no feasible point is asked before a fine one is.
        answers.append(_continue(session, meshes, starts, stage, share, asks_why=count == 1))
        if answers[-1].stopped:
            break
    if all(answer.outcome.status is SolveStatus.EVALUATION_ERROR for answer in answers):
        moved = [moved_start(part.problem, part.scaling) for part in session.parts]
        answers = [_continue(session, meshes, moved, "solve", (0.0, span), asks_why=count == 1)]
    return answers


def _starts(session: Solving[Ended], count: int) -> Iterator[Starts]:
    """The guesses, or what obeys the models between their ends, then the starts beside them."""
    several = [several_starts(part.problem, part.scaling, count) for part in session.parts]
    yield [
        minimum_energy_start(session, session.pinned(index)) or own[0] for index, own in enumerate(several)
    ]
    yield from zip(*(own[1:] for own in several), strict=True)


def _without_turns(
    session: Solving[Ended], mesh: Mesh, solved: Ended, label: str, share: tuple[float, float]
) -> Ended:
    """The answer, solved once more where controls that are angles went round between nodes."""
    if not solved.converged:
        return solved
    found = [unwound(own.transcription.problem, own.trajectory) for own in solved.parts]
    if not any(found):
        return solved
    starts = [item or own.trajectory for item, own in zip(found, solved.parts, strict=True)]
    again = session.solve_parts(_on(session, mesh, starts), label, share, warm=True)
    return again if again.converged else solved


def _continue(
    session: Solving[Ended],
    meshes: Sequence[Mesh],
    first: Starts,
    stage: str,
    share: tuple[float, float],
    *,
    asks_why: bool,
) -> Ended:
    """Solve on mesh after mesh, the first one from ``first``, each other from the answer before.

    ``asks_why``: what ended as infeasible on the last but one comes back as it is, to be diagnosed.
    """
    starts, count = first, len(meshes)
    width = (share[1] - share[0]) / count
    for index, mesh in enumerate(meshes):
        label = stage if count == 1 else f"{stage} level {index + 1} of {count}"
        part = share[0] + index * width, share[0] + (index + 1) * width
        obeys = all(isinstance(start, CubicStart) for start in starts)
        transcriptions = _on(session, mesh, starts)
        solved = session.solve_parts(transcriptions, label, part, warm=starts is not first, obeys=obeys)
        solved = _without_turns(session, mesh, solved, label, part)
        unmet = asks_why and solved.outcome.status is SolveStatus.INFEASIBLE
        if solved.stopped or (unmet and index == count - 2):
            break
        # Building a fine mesh takes its time: ask before.
        stop = session.stop if index + 1 < count else None
        if stop is not None:
            return replace(solved, outcome=replace(solved.outcome, status=stop))
        # A coarse mesh that does not converge says nothing about the next one: start that like the first.
        starts = [own.trajectory for own in solved.parts] if solved.converged else first
    return solved
