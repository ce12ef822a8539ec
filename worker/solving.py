"""The side of the store that a worker and its solves see."""

from __future__ import annotations

import json
import secrets
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any, cast

from solvers.progress import ProgressReport
from worker.keyspace import Keyspace, record_of
from worker.records import JobError, JobRecord, JobStatus
from worker.verdicts import GIVEN_UP, LATE, MAX_LOSSES

_KEPT = tuple(field.name for field in fields(ProgressReport) if field.name != "trajectory")


def new_owner(solver: str = "") -> str:
    """Return a new word for the owner of a job; ``solver`` says whose it is (see `solver_of`)."""
    return solver + secrets.token_hex(16)


def solver_of(worker: str | None, pid: int | str | None = None) -> str:
    """Return how the words begin by which ``worker``, or only its child ``pid``, owns jobs."""
    return f"{worker}/" if pid is None else f"{worker}/{pid}/"


@dataclass(frozen=True, slots=True)
class Assignment:
    """A job that is to be solved: the word by which its solve owns it, its record, its document (JSON)."""

    owner: str
    record: JobRecord
    document: bytes


class Signal(StrEnum):
    """What a running solve hears when it writes its progress."""

    GO = "go"
    CANCEL = "cancel"
    LOST = "lost"


class Solving(Keyspace):
    """Jobs started, reported on, finished, handed back and leased."""

    def start(self, job_id: str, owner: str = "", *, redelivered: bool = False) -> Assignment | None:
        """Make a job running; return what there is to solve, None if there is nothing.

        ``owner`` is a word of `new_owner`; a start that was asked before with the same word is confirmed.
        ``redelivered`` is only counted.
        There is nothing to do for a job that has ended, that is not remembered, that another solve owns,
        that has now lost its worker for the second time (it then ends as failed/worker_lost), or whose
        deadline has passed (failed/time_limit).
        """
        owner = owner or new_owner()
        lost, late = GIVEN_UP.to_json(), LATE.to_json()
        answer = self._run(self._start, job_id, owner, MAX_LOSSES, lost, int(redelivered), late)
        if not isinstance(answer, list):
            return None
        fields, packed = answer
        record = record_of(dict(zip(fields[::2], fields[1::2], strict=True)))
        return Assignment(owner, record, zlib.decompress(packed))

    def report(
        self, job_id: str, owner: str, report: ProgressReport | None, iterates: Sequence[ProgressReport] = ()
    ) -> Signal:
        """Write the progress of a running job (None: nothing new) and hear whether to go on.

        A trajectory and the ``iterates`` since then are told as an event and not kept in the record.
        """
        answer = self._run(self._report, job_id, owner, *_texts(report, iterates))
        return Signal(cast(bytes, answer).decode())

    def finish(
        self,
        job_id: str,
        owner: str,
        status: JobStatus,
        error: JobError | None = None,
        result: bytes | None = None,
        digest: str | None = None,
        last: tuple[ProgressReport | None, Sequence[ProgressReport]] = (None, ()),
    ) -> bool:
        """Write the end of a job, with its ``result`` as `compress` made it.

        By ``digest``, that of what it answers, it is found by `answered`; ``last`` is what was not reported
        yet. Returns False, and writes nothing, if the job is not running or is owned by another solve. Raises
        ResultsUnavailable.
        """
        if not status.final:
            raise ValueError(f"{status} is not a final status")
        failure = "" if error is None else error.to_json()
        keys = [] if digest is None else [self._answer_to(digest)]
        stored = b"" if result is None else self.results_kept.put(job_id, owner, result)
        words = (owner, status.value, failure, stored, len(result or b""), *_texts(*last))
        if self._run(self._finish, job_id, *words, keys=keys):
            return True
        self._drop_unused(job_id, stored)
        return False

    # The side of a worker's main process, which knows of its children's words only how they begin.

    def fail(self, job_id: str, error: JobError, solver: str = "") -> bool:
        """End a running job whose solve cannot speak for itself; False if ``solver`` does not own it."""
        return bool(self._run(self._fail, job_id, solver, error.to_json()))

    def lose(self, job_id: str, solver: str, grace: float, error: JobError) -> bool:
        """Note that ``solver`` has died, so that the job may be started anew; False if it does not own it.

        One that had more than ``grace`` seconds beyond the job's ``max_seconds`` died of that: the job ends
        with ``error``.
        """
        return bool(self._run(self._lose, job_id, solver, grace, error.to_json()))

    def hand_back(self, job_id: str, solver: str = "") -> bool:
        """Put a running job back to queued, as its worker shuts down; False if ``solver`` does not own it."""
        return bool(self._run(self._hand_back, job_id, solver))

    def renew(self, held: Sequence[tuple[str, str, str]]) -> None:
        """Renew the leases of all messages that a worker holds: for each job id, delivery tag and solver."""
        if held:
            keys = [
                self._unacked,
                self._running,
                self._counts,
                *(self._keys(job_id)[0] for job_id, _, _ in held),
            ]
            self._renew(keys=keys, args=[self._lease, *(word for words in held for word in words)])


def _texts(report: ProgressReport | None, iterates: Sequence[ProgressReport]) -> tuple[str, str]:
    """What is kept of a report, and what is told of it with the ``iterates`` before; nothing of no report."""
    if report is None:
        return "", ""
    # Not by asdict, which would copy the trajectory number by number.
    members = _finite({name: getattr(report, name) for name in _KEPT})
    kept = json.dumps(members)
    if report.trajectory is not None:
        members["trajectory"] = report.trajectory
    if iterates:
        members["iterates"] = [_row(one) for one in iterates]
    return kept, json.dumps(members)


def _finite(report: dict[str, Any]) -> dict[str, Any]:
    """Replace the infinities of a first iterate by None: JSON has no word for them."""
    return {
        key: None if isinstance(value, float) and not abs(value) < float("inf") else value
        for key, value in report.items()
    }


def _row(report: ProgressReport) -> list[Any]:
    """An iteration of the past in as few characters as tell of it."""
    finite = _finite({"objective": report.objective, "infeasibility": report.infeasibility})
    return [report.stage, report.iteration, *finite.values()]
