"""Why no feasible point was found: which limits of the document stand against each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from solvers.formulation.elastic import Wish, elastic_problem, wishes_of, wishes_over_all
from solvers.meshes import Mesh
from solvers.part import Part
from solvers.session import Solving
from solvers.solved import Ended, Stand
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription

Place = Callable[[int, str], str]
"""The place in the document of what stands at a pointer into the problem of a part."""

# Slacks up to this part of their scale are what the tolerance of a program leaves.
_NOTHING = 1e-6
# What gives by more than this on a coarse mesh does so on a fine one as well, most probably.
_CLEARLY = 1e-2
# A contradiction may also end a solve in other ways.
_UNDECIDED = (SolveStatus.INFEASIBLE, SolveStatus.ITERATION_LIMIT, SolveStatus.DIVERGED)


@dataclass(frozen=True)
class _Wishes:
    """What may give of each part, and of what counts over all of them, whose slacks the first part has."""

    by_part: Sequence[Sequence[Wish]]
    over_all: Sequence[Wish]

    @classmethod
    def of(cls, session: Solving[Any]) -> _Wishes:
        """Everything that may give."""
        parts = [wishes_of(part.problem, part.scaling, index) for index, part in enumerate(session.parts)]
        return cls(parts, wishes_over_all(*session.over_all))

    def giving(self, relaxed: Stand[Any, Any], least: float) -> list[_Given]:
        """What gives by more than the part ``least`` of its scale."""
        found = [
            _Given(index, wish, part.trajectory)
            for index, (wishes, part) in enumerate(zip(self.by_part, relaxed.parts, strict=True))
            for wish in wishes
        ]
        found += [_Given(None, wish, relaxed.parts[0].trajectory) for wish in self.over_all]
        return [item for item in found if item.share > least]


@dataclass(frozen=True)
class _Given:
    """A wish of a part (None: of all of them), and the trajectory that has its slack."""

    part: int | None
    wish: Wish
    trajectory: Trajectory

    @property
    def violation(self) -> float:
        """By how much it gives."""
        return self.trajectory.design[self.wish.slack]

    @property
    def share(self) -> float:
        """That as a part of its scale."""
        return self.violation / self.wish.scale


def diagnose(
    session: Solving[Ended], place: Place, solved: Ended, finest: Mesh | None = None, span: float = 1.0
) -> tuple[Ended, list[dict[str, Any]]]:
    """Find out what stands against an answer that did not converge, by an elastic re-solve on its mesh.

    ``place``: where things stand in the document. ``finest``: the mesh that is asked for, where the answer is
    of a coarser one. What has to give there by more than coarse meshes err is solved for again on the finest
    mesh, which has the last word; otherwise the finest mesh is solved as if nothing had been found.

    Where limits have to give, the answer comes back as ``infeasible``, with the ``diagnosis`` of the result:
    ``pointer`` into the document, ``name``, ``violation`` in its own units, ``at``, the time at which that is
    reached (None where it belongs to none), and the ``scenario`` where there are several plants; what has to
    give most, compared with its scale, comes first.
    Where none has to give, the elastic answer is a feasible point, and the problem is solved again from it.
    Where the elastic problem is not solved either, the answer comes back as it was.
    ``span``: the part of all work that is done. Raises whatever the progress of the session raises.
    """
    if solved.outcome.status not in _UNDECIDED or session.stop is not None:
        return solved, []
    wishes = _Wishes.of(session)
    if not any((*wishes.by_part, wishes.over_all)):
        return solved, []
    own = [part.transcription for part in solved.parts]
    asked = own if finest is None else [finest(item.problem, item.scaling, item.start) for item in own]
    relaxed = _relaxed(session, own, wishes, span)
    if [item.mesh for item in asked] != [item.mesh for item in own] and not relaxed.stopped:
        if not (relaxed.converged and wishes.giving(relaxed, _CLEARLY)):
            return diagnose(session, place, session.solve_parts(asked, "solve", (span, span)), span=span)
        asked = _from(asked, relaxed)
        relaxed = _relaxed(session, asked, wishes, span, warm=True)
    if relaxed.outcome.status is SolveStatus.CANCELLED:
        return replace(solved, outcome=replace(solved.outcome, status=SolveStatus.CANCELLED)), []
    if not relaxed.converged:
        return solved, []
    found = _report(session, place, wishes.giving(relaxed, _NOTHING))
    if found:
        return replace(solved, outcome=replace(solved.outcome, status=SolveStatus.INFEASIBLE)), found
    again = _from(asked, relaxed)
    answer = session.solve_parts(again, "solve from a feasible point", (span, span), warm=True)
    return (answer if answer.converged or answer.stopped else solved), []


def _from(asked: Sequence[Transcription], solved: Stand[Any, Any]) -> list[Transcription]:
    """The transcriptions, started from an answer."""
    pairs = zip(asked, solved.parts, strict=True)
    return [replace(item, start=part.trajectory) for item, part in pairs]


def _relaxed(
    session: Solving[Ended],
    asked: Sequence[Transcription],
    wishes: _Wishes,
    span: float,
    *,
    warm: bool = False,
) -> Ended:
    """The elastic problem on the meshes of transcriptions and from their starts, which is no level of the
    answer.

    ``warm``: the start is an elastic answer, which has the slacks too.
    """
    parts = []
    for index, (item, own) in enumerate(zip(asked, wishes.by_part, strict=True)):
        over_all = () if index else wishes.over_all
        scales = [wish.scale for wish in (*own, *over_all)]
        scaling = replace(item.scaling, design=np.append(item.scaling.design, scales))
        parts.append(Part(elastic_problem(item.problem, own, item.start, index, over_all), scaling))
    aside = session.relaxed(parts, [side for wish in wishes.over_all for side in wish.sides])
    elastic = [
        replace(item, problem=part.problem, scaling=part.scaling)
        for item, part in zip(asked, parts, strict=True)
    ]
    relaxed = aside.solve_parts(elastic, "diagnose", (span, span), warm=warm)
    session.iterations = aside.iterations
    return relaxed


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


def _report(session: Solving[Any], place: Place, giving: Sequence[_Given]) -> list[dict[str, Any]]:
    """The ``diagnosis`` of a result; a limit of several phases stands there once, where it gives most."""
    found: dict[str, dict[str, Any]] = {}
    for item in sorted(giving, key=lambda item: -item.share):
        limit = item.wish.limit
        pointer = limit.pointer if item.part is None else place(item.part, limit.pointer)
        case = limit.pointer.partition("@")[2]
        found.setdefault(
            f"{pointer}@{case}",
            {
                "pointer": pointer,
                "name": limit.name.partition("@")[0],
                "violation": item.violation,
                "at": _time(session, item),
                **({"scenario": case} if case else {}),
            },
        )
    return list(found.values())


def _time(session: Solving[Any], given: _Given) -> float | None:
    """When a limit has to give most."""
    trajectory = given.trajectory
    if given.part is not None and given.wish.along:
        tau = trajectory.nodes
        excess = given.wish.excess(session.parts[given.part].problem, trajectory, tau)
        return float(trajectory.time(tau)[np.argmax(excess)])
    if given.wish.limit.pointer.startswith("/problem/final_"):
        return trajectory.tf
    return trajectory.t0 if given.wish.limit.pointer.startswith("/problem/initial_") else None
