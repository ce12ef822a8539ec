"""What a client asks of the service and how it reads the answers, without any input or output.

A `Call` is one request with its reader. `Steps` are a generator that yields calls to be sent and pauses to be
made (in seconds), is sent the response or the error of each call, and returns what the caller wants.
`app.client` makes the steps, synchronously or not.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar
from urllib.parse import quote

import httpx

from app.client_answers import Job, JobFailed, JobFilters, RequestRefused, ServerUnreachable, WaitTimeout
from app.client_result import Result
from solvers.builders import Problem

T = TypeVar("T")


Document = Mapping[str, Any] | Problem
FINAL = frozenset({"succeeded", "failed", "cancelled"})

# Seconds of one long poll, and what the network may take besides.
LONG_POLL = 30.0
NETWORK = 30.0
# A refusal with one of these is tried again so often at most, never after a longer pause than this (seconds).
RETRY_STATUS = frozenset({429, 503})
RETRIES = 5
LONGEST_PAUSE = 30.0


@dataclass(frozen=True, slots=True)
class Call(Generic[T]):
    """A request and the reader of its answer; ``seconds`` is what the service may take on purpose."""

    method: str
    path: str
    read: Callable[[httpx.Response], T]
    params: Mapping[str, str | int | float] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    json: object = None
    seconds: float = 0.0

    def request(self, client: httpx.Client | httpx.AsyncClient) -> httpx.Request:
        """The request as ``client`` sends it."""
        return client.build_request(
            self.method,
            self.path,
            params=self.params or None,
            headers=self.headers,
            json=self.json,
            timeout=NETWORK + self.seconds,
        )

    def finish(self, response: httpx.Response) -> T:
        """Read the answer, or raise the refusal."""
        if response.is_success:
            return self.read(response)
        try:
            problem = response.json()
        except ValueError:
            problem = None
        # Something between us and the service (a proxy) may refuse in words of its own.
        raise RequestRefused(response.status_code, problem if isinstance(problem, dict) else {})


@dataclass(frozen=True, slots=True)
class Lost:
    """A connection that failed or broke; ``known``: the service has answered this client before."""

    error: httpx.TransportError
    known: bool


Outcome = httpx.Response | Lost | None
Steps = Generator[Call[Any] | float, Outcome, T]


@dataclass(frozen=True, slots=True)
class Page:
    """A page of the list of jobs, and the address of the next one."""

    jobs: list[Job]
    next: str | None


@dataclass(slots=True)
class Patience:
    """How one request bears refusals for the moment and lost connections: both have their end.

    Every request may be repeated: submitting carries a key by which the service knows it again. A service
    that has answered before is given time to start again; at any other address nobody is waited for.
    """

    refusals: int = 0
    losses: int = 0

    def pause_after_loss(self, lost: Lost) -> float | None:
        """Seconds after which to ask again, ``None`` to give up."""
        self.losses += 1
        broken = isinstance(lost.error, httpx.ReadError | httpx.WriteError | httpx.RemoteProtocolError)
        if self.losses == 1 and broken:
            return 0.0  # a connection that was kept open may have died since
        if lost.known and self.losses <= RETRIES and (broken or isinstance(lost.error, httpx.ConnectError)):
            return _growing(self.losses - 1)
        return None

    def pause_after(self, response: httpx.Response) -> float | None:
        """Seconds after which to ask again, ``None`` when the answer is to be taken as it is."""
        if response.status_code not in RETRY_STATUS or self.refusals >= RETRIES:
            return None
        try:
            asked = float(response.headers["Retry-After"])
        except (KeyError, ValueError):  # none, or a date
            asked = _growing(self.refusals)
        self.refusals += 1
        return asked if asked <= LONGEST_PAUSE else None


def _growing(earlier: int) -> float:
    """The pause after so many earlier ones, seconds."""
    return 0.5 * 2.0**earlier


def ask(call: Call[T]) -> Steps[T]:
    """Send a call until it has its answer, or until patience ends."""
    patience = Patience()
    while True:
        outcome = yield call
        if isinstance(outcome, httpx.Response):
            pause = patience.pause_after(outcome)
            if pause is None:
                return call.finish(outcome)
            yield pause
        elif isinstance(outcome, Lost):
            pause = patience.pause_after_loss(outcome)
            if pause is None:
                raise _unreachable(outcome.error) from outcome.error
            yield pause


def _unreachable(error: httpx.TransportError) -> ServerUnreachable:
    reason = str(error) or type(error).__name__
    return ServerUnreachable(f"no answer from {error.request.url.join('/')}: {reason}")


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
    return Call("GET", _of(job_id), read_json)


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
            "GET", _of(job_id), read_json, params={"wait": round(left, 3)}, seconds=left
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
    final = yield from wait(queued["id"], timeout=timeout, on_progress=on_progress, every=every)
    try:
        return (yield from ask(result(final["id"])))
    except RequestRefused as error:
        if error.status == httpx.codes.NOT_FOUND:
            raise JobFailed(final) from error
        raise


def result(job_id: str) -> Call[Result]:
    """Read the result of a final job."""
    headers = {"Accept": "application/json"}
    return Call("GET", _of(job_id, "/result"), lambda response: Result(response.json()), headers=headers)


def export(job_id: str, kind: Literal["csv", "npz", "mat"]) -> Call[bytes]:
    """Read the result as a file: the sampled trajectory as CSV, or everything as NPZ or MAT."""
    return Call("GET", _of(job_id, "/result"), read_bytes, params={"format": kind})


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
    return Call("GET", _of(job_id, "/trajectory"), read_json, params=params)


def plot(job_id: str, kind: Literal["svg", "png"] = "svg") -> Call[bytes]:
    """Draw states and controls over time."""
    return Call("GET", _of(job_id, f"/plot.{kind}"), read_bytes)


def report(job_id: str) -> Call[bytes]:
    """Read the printable report of a final job, one HTML file."""
    return Call("GET", _of(job_id, "/report.html"), read_bytes)


def bundle(job_id: str) -> Call[bytes]:
    """Read everything about a final job as one ZIP file, for ``ondelette replay``."""
    return Call("GET", _of(job_id, "/bundle.zip"), read_bytes)


def spec(job_id: str) -> Call[dict[str, Any]]:
    """Read the document as it was submitted."""
    return Call("GET", _of(job_id, "/spec"), read_json)


def cancel(job_id: str) -> Call[Job]:
    """Ask that a job be stopped."""
    return Call("POST", _of(job_id, "/cancel"), read_json)


def delete(job_id: str) -> Call[None]:
    """Erase a final job."""
    return Call("DELETE", _of(job_id), _nothing)


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


def _of(job_id: str, part: str = "") -> str:
    return f"/v1/jobs/{quote(job_id, safe='')}{part}"


def read_json(response: httpx.Response) -> Any:
    """Read an answer that is JSON."""
    return response.json()


def read_bytes(response: httpx.Response) -> bytes:
    """Read an answer that is a file."""
    return response.content


def _nothing(response: httpx.Response) -> None:
    return None


def _page(response: httpx.Response) -> Page:
    following = response.links.get("next")
    return Page(response.json()["jobs"], following["url"] if following else None)
