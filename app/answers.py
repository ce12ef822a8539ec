"""Results as they are asked for, and why there is none."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from app.errors import ServiceError
from app.line import Line
from solvers.phases.trajectory import AnyTrajectory
from solvers.phases.trajectory import trajectory_of as read_trajectory
from worker.records import JobRecord, JobStatus
from worker.store import JobStore


class Answers:
    """The results of jobs; may be used by many threads."""

    def __init__(self, store: JobStore, line: Line) -> None:
        self._store = store
        self._line = line

    def result(self, job_id: str) -> bytes:
        """Return the JSON text of a job's result; raises ServiceError while, or where, there is none."""
        return self.result_twice(job_id)[1]

    def result_twice(self, job_id: str) -> tuple[bytes, bytes]:
        """Return what `result` does, compressed by zlib, and as it is."""
        both = self._store.result_twice(job_id)
        if both is not None:
            return both
        record = self._store.get(job_id)
        if not record.status.final:
            raise self._not_ready(record)
        ended = "was cancelled" if record.status is JobStatus.CANCELLED else "failed"
        raise ServiceError("no-result", f"The job {ended} without any iterate, so it has no result.")

    def ended(self, job_id: str) -> tuple[JobRecord, bytes | None]:
        """Return a job that has ended, and its result if it has one; raises ServiceError for any other."""
        record, text = self._store.get(job_id), self._store.result(job_id)
        if not record.status.final:
            raise self._not_ready(record)
        return record, text

    def solved(self, job_id: str) -> tuple[JobRecord, bytes | None]:
        """Return what `ended` does; raises ServiceError for a job of flights, too."""
        record, text = self.ended(job_id)
        if record.flights_of is not None:
            raise _no_answer(record.flights_of)
        return record, text

    def answer(self, job_id: str) -> dict[str, Any]:
        """Return the result of a job that solved a problem; raises ServiceError as `result` does."""
        stored: dict[str, Any] = json.loads(self.result(job_id))
        if stored.get("kind") == "flights":
            raise _no_answer(stored["flights_of"])
        return stored

    def _not_ready(self, record: JobRecord) -> ServiceError:
        """Return the refusal of what only a final job has."""
        detail = f"The job is {record.status}; its result can be read when its status is final."
        return ServiceError("not-ready", detail, headers={"Retry-After": str(self._line.retry_after(record))})


def _no_answer(source: str) -> ServiceError:
    """Return the refusal of what only a job that solved a problem has, not one that flew ``source``."""
    return ServiceError("no-result", f"The job flew the answer of job {source}; it has none of its own.")


def trajectory_of(answer: Mapping[str, Any]) -> AnyTrajectory:
    """Return the trajectory of a result; raises ServiceError for that of an iterate that diverged."""
    try:
        return read_trajectory(answer)
    except TypeError as error:
        raise not_finite() from error


def not_finite() -> ServiceError:
    """Say that the numbers of an iterate that diverged (null in a result) cannot be interpolated."""
    return ServiceError("no-result", "The last iterate is not finite, so it cannot be resampled.")
