"""A client of a running service, synchronous and asynchronous.

    with Client("http://127.0.0.1:8000") as client:
        result = client.solve(document)

A document is a dictionary or a `Problem`; `solvers.builders` makes models for it from what people hold. What
can be asked, with its arguments, stands once in `app.client_calls` and `app.client_sweeps`; the two classes
list it and differ only in how they carry it out.
"""

from __future__ import annotations

import asyncio
import functools
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, Self, TypeVar, Unpack

import httpx

from app import client_calls as calls
from app import client_flights as of_flights
from app import client_sweeps as sweeps
from app.client_answers import (
    ClientError,
    Job,
    JobFailed,
    JobFilters,
    JobProgress,
    RequestRefused,
    ServerUnreachable,
    SweepTimeout,
    WaitTimeout,
)
from app.client_events import SILENCE, Event, Following
from app.client_result import MissingExtraError, NotFiniteError, Result, Samples
from app.client_steps import Call, Lost, Outcome, Steps, ask
from solvers.builders import MINIMUM_TIME, Problem

__all__ = [
    "MINIMUM_TIME",
    "AsyncClient",
    "Client",
    "ClientError",
    "Event",
    "Job",
    "JobFailed",
    "JobFilters",
    "JobProgress",
    "MissingExtraError",
    "NotFiniteError",
    "Problem",
    "RequestRefused",
    "Result",
    "Samples",
    "ServerUnreachable",
    "SweepTimeout",
    "WaitTimeout",
]

P = ParamSpec("P")
T = TypeVar("T")


def _settings(url: str, key: str | None) -> dict[str, Any]:
    """How to reach ``url``: no proxy stands before this machine itself, whatever the environment says."""
    here = httpx.URL(url).host in {"localhost", "127.0.0.1", "::1"}
    headers = {} if key is None else {"Authorization": f"Bearer {key}"}
    return {"base_url": url, "trust_env": not here, "headers": headers}


def _synchronous(make: Callable[P, Call[T] | Steps[T]]) -> Callable[Concatenate[Client, P], T]:
    """The method of `Client` that carries out what ``make`` makes."""

    @functools.wraps(make)
    def method(self: Client, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._carry_out(make(*args, **kwargs))

    return method


def _asynchronous(
    make: Callable[P, Call[T] | Steps[T]],
) -> Callable[Concatenate[AsyncClient, P], Awaitable[T]]:
    """The method of `AsyncClient` that carries out what ``make`` makes."""

    @functools.wraps(make)
    async def method(self: AsyncClient, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return await self._carry_out(make(*args, **kwargs))

    return method


class Client:
    """A synchronous client of the service at ``url``, to be closed: best a context manager.

    ``key`` is the API key, where the service asks for one. Every method raises `RequestRefused` with the
    service's problem document, and `ServerUnreachable`. A refusal with status 429 or 503 is waited out as its
    Retry-After says, five times at most; a service that has answered before and cannot be reached gets a
    quarter of a minute to start again. What is submitted carries an Idempotency-Key: nothing is done twice.
    """

    def __init__(self, url: str = "http://127.0.0.1:8000", *, key: str | None = None) -> None:
        self._http = httpx.Client(**_settings(url, key))
        self._known = False  # whether the service has answered

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def _send(self, call: Call[Any]) -> Outcome:
        try:
            response = self._http.send(call.request(self._http))
        except httpx.TransportError as error:
            return Lost(error, self._known)
        self._known = True
        return response

    def _carry_out(self, wanted: Call[T] | Steps[T]) -> T:
        steps = ask(wanted) if isinstance(wanted, Call) else wanted
        outcome: Outcome = None
        try:
            while True:
                step = steps.send(outcome)
                if isinstance(step, Call):
                    outcome = self._send(step)
                else:
                    time.sleep(step)
                    outcome = None
        except StopIteration as stop:
            value: T = stop.value
            return value

    solve = _synchronous(calls.solve)
    submit = _synchronous(calls.submit)
    validate = _synchronous(calls.validate)
    job = _synchronous(calls.job)
    wait = _synchronous(calls.wait)
    result = _synchronous(calls.result)
    export = _synchronous(calls.export)
    trajectory = _synchronous(calls.trajectory)
    plot = _synchronous(calls.plot)
    report = _synchronous(calls.report)
    bundle = _synchronous(calls.bundle)
    spec = _synchronous(calls.spec)
    cancel = _synchronous(calls.cancel)
    delete = _synchronous(calls.delete)
    cases = _synchronous(calls.cases)
    case = _synchronous(calls.case)
    flights = _synchronous(of_flights.flights)
    submit_flights = _synchronous(of_flights.submit_flights)
    sweep = _synchronous(sweeps.sweep)
    submit_sweep = _synchronous(sweeps.submit_sweep)
    read_sweep = _synchronous(sweeps.read_sweep)
    wait_for_sweep = _synchronous(sweeps.wait_for_sweep)
    export_sweep = _synchronous(sweeps.export_sweep)
    cancel_sweep = _synchronous(sweeps.cancel_sweep)

    def jobs(self, **filters: Unpack[JobFilters]) -> Iterator[Job]:
        """Iterate over all jobs that match, newest first, page after page of ``limit``."""
        page = self._carry_out(calls.first_page(filters))
        yield from page.jobs
        while page.next is not None:
            page = self._carry_out(calls.next_page(page))
            yield from page.jobs

    def events(self, job_id: str, *, after: str | None = None) -> Iterator[Event]:
        """Iterate over what happens to a job until it ends, from its beginning or behind the event ``after``.

        A stream that is cut is taken up again.
        """
        following = Following(job_id, after)
        while not following.ended:
            error: httpx.TransportError | None = None
            pause: float | None = None
            try:
                with self._http.stream(
                    "GET", following.path, headers=following.headers, timeout=SILENCE
                ) as response:
                    if not response.is_success:
                        response.read()
                    pause = following.begin(response)
                    for line in response.iter_lines() if pause is None else ():
                        if (event := following.read(line)) is not None:
                            yield event
            except httpx.TransportError as cut:
                error = cut
            if not following.ended:
                time.sleep(following.cut(error) if pause is None else pause)


class AsyncClient:
    """The same client for asyncio: the methods of `Client`, awaited."""

    def __init__(self, url: str = "http://127.0.0.1:8000", *, key: str | None = None) -> None:
        self._http = httpx.AsyncClient(**_settings(url, key))
        self._known = False

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def _send(self, call: Call[Any]) -> Outcome:
        try:
            response = await self._http.send(call.request(self._http))
        except httpx.TransportError as error:
            return Lost(error, self._known)
        self._known = True
        return response

    async def _carry_out(self, wanted: Call[T] | Steps[T]) -> T:
        steps = ask(wanted) if isinstance(wanted, Call) else wanted
        outcome: Outcome = None
        try:
            while True:
                step = steps.send(outcome)
                if isinstance(step, Call):
                    outcome = await self._send(step)
                else:
                    await asyncio.sleep(step)
                    outcome = None
        except StopIteration as stop:
            value: T = stop.value
            return value

    solve = _asynchronous(calls.solve)
    submit = _asynchronous(calls.submit)
    validate = _asynchronous(calls.validate)
    job = _asynchronous(calls.job)
    wait = _asynchronous(calls.wait)
    result = _asynchronous(calls.result)
    export = _asynchronous(calls.export)
    trajectory = _asynchronous(calls.trajectory)
    plot = _asynchronous(calls.plot)
    report = _asynchronous(calls.report)
    bundle = _asynchronous(calls.bundle)
    spec = _asynchronous(calls.spec)
    cancel = _asynchronous(calls.cancel)
    delete = _asynchronous(calls.delete)
    cases = _asynchronous(calls.cases)
    case = _asynchronous(calls.case)
    flights = _asynchronous(of_flights.flights)
    submit_flights = _asynchronous(of_flights.submit_flights)
    sweep = _asynchronous(sweeps.sweep)
    submit_sweep = _asynchronous(sweeps.submit_sweep)
    read_sweep = _asynchronous(sweeps.read_sweep)
    wait_for_sweep = _asynchronous(sweeps.wait_for_sweep)
    export_sweep = _asynchronous(sweeps.export_sweep)
    cancel_sweep = _asynchronous(sweeps.cancel_sweep)

    async def events(self, job_id: str, *, after: str | None = None) -> AsyncIterator[Event]:
        """Iterate over what happens to a job, as `Client.events`."""
        following = Following(job_id, after)
        while not following.ended:
            error: httpx.TransportError | None = None
            pause: float | None = None
            try:
                async with self._http.stream(
                    "GET", following.path, headers=following.headers, timeout=SILENCE
                ) as response:
                    if not response.is_success:
                        await response.aread()
                    pause = following.begin(response)
                    if pause is None:
                        async for line in response.aiter_lines():
                            if (event := following.read(line)) is not None:
                                yield event
            except httpx.TransportError as cut:
                error = cut
            if not following.ended:
                await asyncio.sleep(following.cut(error) if pause is None else pause)

    async def jobs(self, **filters: Unpack[JobFilters]) -> AsyncIterator[Job]:
        """Iterate over all jobs that match, newest first, page after page of ``limit``."""
        page = await self._carry_out(calls.first_page(filters))
        while True:
            for job in page.jobs:
                yield job
            if page.next is None:
                return
            page = await self._carry_out(calls.next_page(page))
