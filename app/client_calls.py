"""What a client asks of the service and how it reads the answers; see `app.client_steps`."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar
from urllib.parse import quote

import httpx

from app.client_answers import Job, JobFailed, JobFilters, RequestRefused, WaitTimeout
from app.client_result import Result
from app.client_steps import Call, Steps, ask, read_bytes, read_json
from solvers.builders import Problem

T = TypeVar("T")

Document = Mapping[str, Any] | Problem
FINAL = frozenset({"succeeded", "failed", "cancelled"})
# Seconds of one long poll.
LONG_POLL = 30.0


@dataclass(frozen=True, slots=True)
class Page:
    """A page of the list of jobs, and the address of the next one."""

    jobs: list[Job]
    next: str | None


def plain(document: Document) -> Mapping[str, Any]:
    """The document as JSON types."""
    return document.to_dict() if isinstance(document, Problem) else document


def submit(document: Document, *, idempotency_key: str | None = None) -> Call[Job]:
    """Queue a job document and return the job."""
    key = idempotency_key or uuid.uuid4().hex
    return Call("POST", "/v1/jobs", read_json, json=plain(document), headers={"Idempotency-Key": key})


def validate(document: Document) -> Call[dict[str, Any]]:
    """Check a document without queueing it; returns sizes and a time estimate."""
    return Call("POST", "/v1/validate", read_json, json=plain(document))


def job(job_id: str) -> Call[Job]:
    """Read a job."""
    return Call("GET", path_of(job_id), read_json)


def wait(
    job_id: str,
    *,
    timeout: float | None = None,
    on_progress: Callable[[Job], object] | None = None,
    every: float = 1.0,
) -> Steps[Job]:
    """Return the job when it is final.

    ``timeout`` in seconds raises `WaitTimeout` (the job goes on); ``on_progress`` is shown the job every
    ``every`` seconds.
    """
    deadline = None if timeout is None else time.monotonic() + timeout
    poll = LONG_POLL if on_progress is None else every
    while True:
        left = poll if deadline is None else max(min(poll, deadline - time.monotonic()), 0.0)
        poll_once: Call[Job] = Call(
            "GET", path_of(job_id), read_json, params={"wait": round(left, 3)}, seconds=left
        )
        current = yield from ask(poll_once)
        if on_progress is not None:
            on_progress(current)
        if current["status"] in FINAL:
            return current
        if deadline is not None and time.monotonic() >= deadline:
            raise WaitTimeout(current)


def solve(
    document: Document,
    *,
    timeout: float | None = None,
    on_progress: Callable[[Job], object] | None = None,
    every: float = 1.0,
) -> Steps[Result]:
    """Submit a job document, wait, and return its result: look at its ``success``.

    The other arguments are those of ``wait``. Raises `JobFailed` when the job ended without an iterate.
    """
    queued = yield from ask(submit(document))
    return (yield from awaited(queued["id"], result, timeout, on_progress, every))


def awaited(
    job_id: str,
    read: Callable[[str], Call[T]],
    timeout: float | None,
    on_progress: Callable[[Job], object] | None,
    every: float,
) -> Steps[T]:
    """Wait for the end of a job as `wait` does, then ``read`` its result; raises `JobFailed` without one."""
    final = yield from wait(job_id, timeout=timeout, on_progress=on_progress, every=every)
    try:
        return (yield from ask(read(job_id)))
    except RequestRefused as error:
        if error.status == httpx.codes.NOT_FOUND:
            raise JobFailed(final) from error
        raise


def result(job_id: str) -> Call[Result]:
    """Read the result of a final job."""
    headers = {"Accept": "application/json"}
    return Call("GET", path_of(job_id, "/result"), lambda response: Result(response.json()), headers=headers)


def export(job_id: str, kind: Literal["csv", "npz", "mat"]) -> Call[bytes]:
    """Read the result as a file: the sampled trajectory as CSV, or everything as NPZ or MAT."""
    return Call("GET", path_of(job_id, "/result"), read_bytes, params={"format": kind})


def trajectory(
    job_id: str,
    *,
    samples: int | None = None,
    times: Iterable[float] | None = None,
    step: float | None = None,
    derivatives: bool = False,
) -> Call[dict[str, Any]]:
    """Resample at ``samples`` equidistant points, at ``times``, or every ``step`` (in seconds)."""
    params: dict[str, str | int | float] = {"derivatives": 1} if derivatives else {}
    if samples is not None:
        params["samples"] = samples
    if times is not None:
        params["t"] = ",".join(repr(float(instant)) for instant in times)
    if step is not None:
        params["dt"] = step
    return Call("GET", path_of(job_id, "/trajectory"), read_json, params=params)


def plot(job_id: str, kind: Literal["svg", "png"] = "svg") -> Call[bytes]:
    """Draw states and controls over time."""
    return Call("GET", path_of(job_id, f"/plot.{kind}"), read_bytes)


def report(job_id: str) -> Call[bytes]:
    """Read the printable report of a final job, one HTML file."""
    return Call("GET", path_of(job_id, "/report.html"), read_bytes)


def bundle(job_id: str) -> Call[bytes]:
    """Read everything about a final job as one ZIP file, for ``ondelette replay``."""
    return Call("GET", path_of(job_id, "/bundle.zip"), read_bytes)


def spec(job_id: str) -> Call[dict[str, Any]]:
    """Read the document as it was submitted."""
    return Call("GET", path_of(job_id, "/spec"), read_json)


def cancel(job_id: str) -> Call[Job]:
    """Ask that a job be stopped."""
    return Call("POST", path_of(job_id, "/cancel"), read_json)


def delete(job_id: str) -> Call[None]:
    """Erase a final job."""
    return Call("DELETE", path_of(job_id), _nothing)


def first_page(filters: JobFilters) -> Call[Page]:
    """The first page of the jobs that match, newest first."""
    params = {key: str(value) for key, value in filters.items() if value is not None}
    return Call("GET", "/v1/jobs", _page, params=params)


def next_page(page: Page) -> Call[Page]:
    """The page after ``page``."""
    assert page.next is not None
    return Call("GET", page.next, _page)


def cases() -> Call[list[dict[str, Any]]]:
    """List the cases on board."""
    return Call("GET", "/v1/cases", lambda response: list(response.json()["cases"]))


def case(name: str) -> Call[dict[str, Any]]:
    """Read the job document of a case."""
    return Call("GET", f"/v1/cases/{quote(name, safe='')}", read_json)


def path_of(job_id: str, part: str = "") -> str:
    """The address of a job, or of a ``part`` of it."""
    return f"/v1/jobs/{quote(job_id, safe='')}{part}"


def _nothing(response: httpx.Response) -> None:
    return None


def _page(response: httpx.Response) -> Page:
    following = response.links.get("next")
    return Page(response.json()["jobs"], following["url"] if following else None)
