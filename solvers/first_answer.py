"""The first answer to a problem: from an earlier job, or from one or several starts, from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from solvers.guess import Start, WarmStart
from solvers.meshes import Mesh
from solvers.minimum_energy import CubicStart, minimum_energy_start
from solvers.session import Account, Session, Solved, Stand
from solvers.starts import several_starts
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory


def first_answers(
    session: Session, meshes: Sequence[Mesh], starts: int, earlier: Trajectory | None, span: float
) -> list[Solved]:
    """Answers on the finest mesh, best first: one for each start, or the one that ``earlier`` leads to.

    ``span``: the part of all work that this is. Raises whatever the progress of the session raises.
    """
    answers = _from_earlier(session, meshes, earlier, span) or _from_starts(session, meshes, starts, span)
    return sorted(answers, key=rank)


def _from_earlier(
    session: Session, meshes: Sequence[Mesh], earlier: Trajectory | None, span: float
) -> list[Solved]:
    """The finest mesh solved from an earlier answer; nothing if there is none or it leads nowhere."""
    if earlier is None:
        return []
    problem = session.problem
    start = WarmStart(earlier, problem.guess, problem.states, problem.controls)
    transcription = meshes[-1](problem, session.scaling, start)
    solved = session.solve(transcription, "solve from the earlier job", (0.0, span), warm=True)
    return [solved] if solved.converged or solved.stopped else []


def _from_starts(session: Session, meshes: Sequence[Mesh], count: int, span: float) -> list[Solved]:
    """An answer from each start, ``span`` of all work; fewer if somebody or the clock asks to stop."""
    return from_starts(
        _starts(session, count),
        count,
        span,
        # Where nothing else is tried, why a coarse mesh has no feasible point is asked before a fine one is.
        lambda start, stage, share: _continue(session, meshes, start, stage, share, asks_why=count == 1),
    )


def _starts(session: Session, count: int) -> Iterator[Start]:
    """The guess, or what obeys the model between its ends, then the starts beside it."""
    first, *others = several_starts(session.problem, session.scaling, count)
    yield minimum_energy_start(session) or first
    yield from others


Ended = TypeVar("Ended", bound=Stand[Any, Any])

SolveOn = Callable[[int, Any, str, tuple[float, float], bool], Ended]
"""Solves the mesh of an index from a start: with its label, the part of all work, whether that is near."""


def from_starts(
    starts: Iterable[Any],
    count: int,
    span: float,
    solve_from: Callable[[Any, str, tuple[float, float]], Ended],
) -> list[Ended]:
    """What ``solve_from`` makes of each of ``count`` starts, with its label and part of ``span``."""
    answers: list[Ended] = []
    for index, start in enumerate(starts):
        stage = "solve" if count == 1 else f"start {index + 1} of {count}"
        share = span * index / count, span * (index + 1) / count
        answers.append(solve_from(start, stage, share))
        if answers[-1].stopped:
            break
    return answers


def rank(answer: Stand[Any, Any]) -> tuple[bool, float]:
    """Converged answers first, then the smallest objective."""
    return not answer.converged, answer.objective if np.isfinite(answer.objective) else np.inf


def _continue(
    session: Session,
    meshes: Sequence[Mesh],
    first: Start,
    stage: str,
    share: tuple[float, float],
    *,
    asks_why: bool,
) -> Solved:
    """Solve mesh after mesh, each from the answer of the one before; see :func:`continued`."""

    def solve_on(index: int, start: Start, label: str, part: tuple[float, float], warm: bool) -> Solved:
        transcription = meshes[index](session.problem, session.scaling, start)
        obeys = isinstance(start, CubicStart)
        return session.solve(transcription, label, part, warm=warm, obeys=obeys)

    return continued(session, len(meshes), solve_on, first, stage, share, asks_why=asks_why)


def continued(
    account: Account,
    meshes: int,
    solve_on: SolveOn[Ended],
    first: Any,
    stage: str,
    share: tuple[float, float],
    *,
    asks_why: bool = False,
) -> Ended:
    """Solve on mesh after mesh, the first one from ``first``, each other from the answer before.

    ``asks_why``: what ended as infeasible on the last but one comes back as it is, to be diagnosed.
    """
    start, width = first, (share[1] - share[0]) / meshes
    for index in range(meshes):
        label = stage if meshes == 1 else f"{stage} level {index + 1} of {meshes}"
        part = share[0] + index * width, share[0] + (index + 1) * width
        solved = solve_on(index, start, label, part, start is not first)
        unmet = asks_why and solved.outcome.status is SolveStatus.INFEASIBLE
        if solved.stopped or (unmet and index == meshes - 2):
            break
        # Building a fine mesh takes its time: ask before.
        stop = account.stop if index + 1 < meshes else None
        if stop is not None:
            return replace(solved, outcome=replace(solved.outcome, status=stop))
        # A coarse mesh that does not converge says nothing about the next one: start that like the first.
        start = solved.trajectory if solved.converged else first
    return solved
