"""What a client is told: jobs, and the errors that it raises."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, TypedDict

from solvers.errors import OndeletteError


class JobProgress(TypedDict):
    """The last report of a running job; ``fraction`` is an estimate in [0, 1]."""

    stage: str
    iteration: int
    objective: float | None
    infeasibility: float | None
    fraction: float | None


class Job(TypedDict):
    """A job as the service tells it; times are RFC 3339 texts in UTC."""

    id: str
    name: str | None
    tags: list[str]
    status: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    method: str
    created_at: str
    started_at: str | None
    finished_at: str | None
    progress: JobProgress | None
    error: dict[str, Any] | None
    attempts: int
    cancel_requested: bool
    project: str
    submitted_by: str | None
    sweep: str | None
    links: dict[str, str]


class JobFilters(TypedDict, total=False):
    """Which jobs to list, and how many on a page (``limit``)."""

    status: str | None
    method: str | None
    tag: str | None
    name: str | None
    limit: int | None


class ClientError(OndeletteError):
    """Root of what a client raises."""


class ServerUnreachable(ClientError):
    """Nobody answers at the address, or not in time, or not to the end."""


class RequestRefused(ClientError):
    """The service refused a request; the members of its problem document (RFC 9457).

    ``errors`` holds ``{"pointer", "detail"}`` for each mistake of a job document; ``type`` is a URI.
    """

    def __init__(self, status: int, problem: Mapping[str, Any]) -> None:
        self.status = status
        self.problem = dict(problem)
        self.type = str(problem.get("type", "about:blank"))
        self.title = str(problem.get("title", f"HTTP {status}"))
        self.detail = str(problem.get("detail", ""))
        self.errors: list[dict[str, str]] = list(problem.get("errors", ()))
        super().__init__(f"{self.title}: {self.detail}" if self.detail else self.title)


class JobFailed(ClientError):
    """A job ended without any result to read; ``job`` says why."""

    def __init__(self, job: Job) -> None:
        self.job = job
        reason = (job["error"] or {}).get("detail") or "there is no result"
        super().__init__(f"job {job['id']} {job['status']}: {reason}")


class WaitTimeout(ClientError):
    """A job was not final in time; ``job`` is its last reading."""

    def __init__(self, job: Job) -> None:
        self.job = job
        super().__init__(f"job {job['id']} is still {job['status']}")


class SweepTimeout(ClientError):
    """Not all jobs of a sweep had ended in time; ``sweep`` is its last reading, without its table."""

    def __init__(self, sweep: dict[str, Any]) -> None:
        self.sweep = sweep
        left = sweep["counts"]["queued"] + sweep["counts"]["running"]
        super().__init__(f"sweep {sweep['id']} is still {sweep['status']}: {left} of its jobs have not ended")
