"""Answers of neighbouring points of a sweep, from which the next point starts.

A worker's process remembers the points that it solved itself; one that knows none of a sweep yet, for it was
just started, looks for those that others solved last.
"""

from __future__ import annotations

import json
from collections import OrderedDict, deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from solvers.phases.trajectory import AnyTrajectory, trajectory_of
from solvers.start.prediction import predicted
from worker.records import SweepPlace
from worker.store import JobStore
from worker.sweeps import SweepStore

_SWEEPS = 4
_ANSWERS = 32
# So many answers in a row predict the next one.
_ROW = 3

Place = tuple[float, ...]


class Neighbours:
    """The answers that this process has found, of the sweeps that it worked on last."""

    def __init__(self, store: JobStore, sweeps: SweepStore) -> None:
        self._store = store
        self._sweeps = sweeps
        self._answers: OrderedDict[str, deque[tuple[Place, AnyTrajectory]]] = OrderedDict()
        self._found: str | None = None

    def nearest(self, at: SweepPlace) -> AnyTrajectory | None:
        """Return where to start a point from, None where nothing is known.

        It is what the solved points nearest to ``at`` predict where they lie in a row with it, else the
        answer of the nearest one.
        """
        own = self._answers.get(at.sweep)
        if own:
            return _start(sorted(own, key=lambda entry: _distance(entry[0], at.place)), at.place)
        solved = self._sweeps.solved_last(at.sweep)
        return self._read(
            job_id for job_id, place in sorted(solved, key=lambda it: _distance(it[1], at.place))
        )

    def found(self, at: SweepPlace, job_id: str, answer: AnyTrajectory) -> None:
        """Remember the answer of a point; others are told of it when the job has ended."""
        self._answers.setdefault(at.sweep, deque(maxlen=_ANSWERS)).append((at.place, answer))
        self._found = job_id
        self._answers.move_to_end(at.sweep)
        while len(self._answers) > _SWEEPS:
            self._answers.popitem(last=False)

    def ended(self, at: SweepPlace, job_id: str, ending: Mapping[str, Any]) -> None:
        """Note the end of a point's job (see `ending_of`), and whether others may start from its answer."""
        self._sweeps.note(at, ending, job_id if self._found == job_id else None)

    def _read(self, job_ids: Iterable[str]) -> AnyTrajectory | None:
        kept = (result for job_id in job_ids if (result := self._store.kept_result(job_id)) is not None)
        result = next(kept, None)
        return None if result is None else trajectory_of(json.loads(result))


def _start(known: Sequence[tuple[Place, AnyTrajectory]], at: Place) -> AnyTrajectory:
    """What a point starts from, of the answers that are ``known``, nearest first."""
    place, nearest = known[0]
    axes = [axis for axis, (own, other) in enumerate(zip(at, place, strict=True)) if own != other]
    if len(axes) != 1:
        return nearest
    (axis,) = axes
    row = {
        other[axis]: answer
        for other, answer in reversed(known)
        if _distance(other, at) == (other[axis] - at[axis]) ** 2 > 0.0
    }
    places = sorted(row, key=lambda own: abs(own - at[axis]))[:_ROW]
    for count in range(len(places), 1, -1):
        start = predicted(places[:count], [row[own] for own in places[:count]], at[axis])
        if start is not None:
            return start
    return nearest


def _distance(first: Place, second: Place) -> float:
    return sum((a - b) ** 2 for a, b in zip(first, second, strict=True))
