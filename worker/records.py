"""What is remembered of a job: its record, its status and the transitions that are allowed."""

from __future__ import annotations

import json
import math
import re
import secrets
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

DEFAULT_PROJECT = "default"
"""The project of jobs that were submitted without a key."""

_JOB_ID = re.compile(r"[0-9a-f]{8}-[0-9a-f]{4}-7[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}")

_EVENT_NUMBER = re.compile(r"\d{1,18}-\d{1,18}")


class JobStatus(StrEnum):
    """Where a job stands. The last three are final: a job never leaves them."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def final(self) -> bool:
        """Tell whether the job has ended."""
        return not TRANSITIONS[self]


TRANSITIONS: Mapping[JobStatus, frozenset[JobStatus]] = {
    JobStatus.QUEUED: frozenset({JobStatus.RUNNING, JobStatus.CANCELLED}),
    # Back to queued when a worker that shuts down hands the job back.
    JobStatus.RUNNING: frozenset(
        {JobStatus.SUCCEEDED, JobStatus.FAILED, JobStatus.CANCELLED, JobStatus.QUEUED}
    ),
    JobStatus.SUCCEEDED: frozenset(),
    JobStatus.FAILED: frozenset(),
    JobStatus.CANCELLED: frozenset(),
}


class Priority(StrEnum):
    """How urgent a job is, most urgent first."""

    HIGH = "high"
    NORMAL = "normal"
    LOW = "low"


class FailureType(StrEnum):
    """Why a job failed: the endings of a solve without success, and those in which there was no solve."""

    INFEASIBLE = "infeasible"
    ITERATION_LIMIT = "iteration_limit"
    TIME_LIMIT = "time_limit"
    DIVERGED = "diverged"
    EVALUATION_ERROR = "evaluation_error"
    UNVERIFIED = "unverified"
    WORKER_LOST = "worker_lost"
    OUT_OF_MEMORY = "out_of_memory"
    INTERNAL = "internal"


@dataclass(frozen=True, slots=True)
class JobError:
    """Why a job failed, for programs (``type``) and for people (``title``, ``detail``)."""

    type: FailureType
    title: str
    detail: str

    def to_json(self) -> str:
        """Return the error as a JSON object."""
        return json.dumps({"type": self.type.value, "title": self.title, "detail": self.detail})

    @classmethod
    def from_json(cls, text: str) -> JobError:
        """Read what `to_json` wrote."""
        members = json.loads(text)
        return cls(FailureType(members["type"]), members["title"], members["detail"])


@dataclass(frozen=True, slots=True)
class SweepPlace:
    """Where a job stands in the sweep that it belongs to.

    ``index`` counts the points of its table from 0; ``place`` are the coordinates of the point in [0, 1].
    """

    sweep: str
    index: int
    place: tuple[float, ...]

    def to_json(self) -> str:
        """Return the place as a JSON list."""
        return json.dumps([self.sweep, self.index, self.place])

    @classmethod
    def from_json(cls, text: str) -> SweepPlace:
        """Read what `to_json` wrote."""
        sweep, index, place = json.loads(text)
        return cls(sweep, index, tuple(place))


@dataclass(frozen=True, slots=True)
class JobRecord:
    """A job as it is remembered; times in seconds since 1970, UTC.

    ``version`` grows by one with every change, so that two readings are equal exactly if their versions are.
    ``estimate`` is the time that the solve was expected to take, in seconds, when the job was accepted.
    ``submitted_by`` is the id of the API key. ``attempts`` counts starts, ``losses`` those whose worker
    vanished without a word. After ``deadline_at`` nobody waits for the answer any more. An ended job is kept
    until ``expires_at``, or until it is erased if it is ``pinned``. ``reused_from`` is the job whose answer
    this one has, which was not solved then. ``flights_of`` is the job whose answer this one flies; its
    document then says how (`solvers.spec.flights`).
    """

    id: str
    status: JobStatus
    method: str
    max_seconds: float
    created_at: float
    estimate: float = 0.0
    name: str | None = None
    tags: tuple[str, ...] = ()
    priority: Priority = Priority.NORMAL
    deadline_at: float | None = None
    sweep: SweepPlace | None = None
    flights_of: str | None = None
    project: str = DEFAULT_PROJECT
    submitted_by: str | None = None
    webhook: str | None = None
    started_at: float | None = None
    finished_at: float | None = None
    progress: Mapping[str, Any] | None = None
    error: JobError | None = None
    attempts: int = 0
    losses: int = 0
    cancel_requested: bool = False
    has_result: bool = False
    expires_at: float | None = None
    pinned: bool = False
    reused_from: str | None = None
    version: int = field(default=1)

    def seconds_left(self, now: float) -> float:
        """Return how long a solve may take that starts ``now``: until its limit or its deadline."""
        until_deadline = math.inf if self.deadline_at is None else self.deadline_at - now
        return max(0.0, min(self.max_seconds, until_deadline))

    def to_hash(self) -> dict[str, str]:
        """Return the record of a new job as fields of a Redis hash (what is absent is left out)."""
        fields = {
            "id": self.id,
            "status": self.status.value,
            "method": self.method,
            "max_seconds": repr(self.max_seconds),
            "created_at": repr(self.created_at),
            "estimate": repr(self.estimate),
            "tags": json.dumps(self.tags),
            "project": self.project,
            "priority": self.priority.value,
            "version": str(self.version),
        }
        if self.name is not None:
            fields["name"] = self.name
        if self.deadline_at is not None:
            fields["deadline_at"] = repr(self.deadline_at)
        if self.webhook is not None:
            fields["webhook"] = self.webhook
        if self.submitted_by is not None:
            fields["submitted_by"] = self.submitted_by
        if self.sweep is not None:
            fields["sweep"] = self.sweep.to_json()
        if self.flights_of is not None:
            fields["flights_of"] = self.flights_of
        return fields

    @classmethod
    def from_hash(cls, fields: Mapping[str, str]) -> JobRecord:
        """Read a record from the fields of its Redis hash."""
        return cls(
            id=fields["id"],
            status=JobStatus(fields["status"]),
            method=fields["method"],
            max_seconds=float(fields["max_seconds"]),
            created_at=float(fields["created_at"]),
            estimate=float(fields["estimate"]),
            name=fields.get("name"),
            tags=tuple(json.loads(fields["tags"])),
            priority=Priority(fields["priority"]),
            deadline_at=float(fields["deadline_at"]) if "deadline_at" in fields else None,
            project=fields["project"],
            submitted_by=fields.get("submitted_by"),
            webhook=fields.get("webhook"),
            sweep=SweepPlace.from_json(fields["sweep"]) if "sweep" in fields else None,
            flights_of=fields.get("flights_of"),
            started_at=float(fields["started_at"]) if "started_at" in fields else None,
            finished_at=float(fields["finished_at"]) if "finished_at" in fields else None,
            progress=json.loads(fields["progress"]) if "progress" in fields else None,
            error=JobError.from_json(fields["error"]) if "error" in fields else None,
            attempts=int(fields.get("attempts", 0)),
            losses=int(fields.get("losses", 0)),
            cancel_requested=fields.get("cancel") == "1",
            has_result=fields.get("has_result") == "1",
            expires_at=float(fields["expires_at"]) if "expires_at" in fields else None,
            pinned=fields.get("pinned") == "1",
            reused_from=fields.get("reused_from"),
            version=int(fields["version"]),
        )


FIRST = "0-0"
"""Behind this number begin the events of every job."""


@dataclass(frozen=True, slots=True)
class JobEvent:
    """Something that happened to a job; ``number`` grows (milliseconds since 1970, a hyphen, a count).

    ``kind`` is ``status`` (data: ``status``, ``attempts``, ``cancel_requested``, ``error``, and ``at``, in
    seconds since 1970), ``progress`` (the report) or ``result`` (there is one now; its size as it is kept).
    """

    number: str
    kind: str
    data: Mapping[str, Any]

    @property
    def last(self) -> bool:
        """Tell whether nothing follows: the job has reached a final status."""
        return self.kind == "status" and JobStatus(self.data["status"]).final


def is_event_number(text: str) -> bool:
    """Tell whether ``text`` is written like the number of an event."""
    return _EVENT_NUMBER.fullmatch(text) is not None


def new_job_id(now: float | None = None) -> str:
    """Return a new job id: a UUID of version 7 (RFC 9562, method 3) with 62 bits that cannot be guessed.

    Ids sort by the time of their making, to a quarter of a microsecond (12 bits below the millisecond).
    """
    milliseconds, fraction = divmod((time.time() if now is None else now) * 1000, 1)
    value = (
        int(milliseconds) << 80 | 0x7 << 76 | int(fraction * 4096) << 64 | 0b10 << 62 | secrets.randbits(62)
    )
    return str(uuid.UUID(int=value))


def is_job_id(text: str) -> bool:
    """Tell whether ``text`` is written like an id of `new_job_id`."""
    return _JOB_ID.fullmatch(text) is not None


def timestamp(seconds: float) -> str:
    """Return a moment in seconds since 1970 as RFC 3339 text in UTC with milliseconds."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
