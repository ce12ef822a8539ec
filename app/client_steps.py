"""How a client carries out what it asks, without any input or output: a request, its reader, and patience.

A `Call` is one request with its reader. `Steps` are a generator that yields calls to be sent and pauses to be
made (in seconds), is sent the response or the loss of each call, and returns what the caller wants.
`app.client` makes the steps, synchronously or not.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import httpx

from app.client_answers import RequestRefused, ServerUnreachable

T = TypeVar("T")

# Seconds that the network may take besides what the service takes on purpose.
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
        if not _may_pass(response) or self.refusals >= RETRIES:
            return None
        try:
            asked = float(response.headers["Retry-After"])
        except (KeyError, ValueError):  # none, or a date
            asked = _growing(self.refusals)
        self.refusals += 1
        return asked if asked <= LONGEST_PAUSE else None


def _may_pass(response: httpx.Response) -> bool:
    """Whether a refusal is one for the moment."""
    # The first try of a request whose answer was lost on the way may still be at work.
    in_flight = response.status_code == httpx.codes.CONFLICT and "Idempotency-Key" in response.request.headers
    return response.status_code in RETRY_STATUS or (in_flight and "Retry-After" in response.headers)


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


def read_json(response: httpx.Response) -> Any:
    """Read an answer that is JSON."""
    return response.json()


def read_bytes(response: httpx.Response) -> bytes:
    """Read an answer that is a file."""
    return response.content
