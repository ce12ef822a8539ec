"""The application in the test's own process, over a real store and a queue that nobody serves."""

from __future__ import annotations

import contextlib
import copy
import json
import time
import zlib
from collections.abc import Callable, Iterator
from typing import Any

import anyio.from_thread
import httpx
import pytest
from fastapi import FastAPI
from redis import Redis

from app.main import create_app
from app.settings import Settings
from solvers.solve import solve
from solvers.spec import check_document
from tests.bad_documents import FLEXIBLE_SPACECRAFT
from worker.outcome import of_solution
from worker.queue import JobQueue
from worker.records import JobRecord, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore, compress


@pytest.fixture
def document() -> dict[str, Any]:
    """A good document, to be changed at will."""
    return copy.deepcopy(FLEXIBLE_SPACECRAFT)


@pytest.fixture
def app(queue_settings: QueueSettings) -> FastAPI:
    """The application over keys of its own."""
    return create_app(Settings(broker=queue_settings.broker, prefix=queue_settings.prefix))


class InProcess(httpx.BaseTransport):
    """Carries requests to an application that runs in an event loop of its own thread."""

    def __init__(self, app: FastAPI, portal: anyio.from_thread.BlockingPortal) -> None:
        self._transport = httpx.ASGITransport(app)
        self._portal = portal

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        async def answer() -> tuple[httpx.Response, bytes]:
            response = await self._transport.handle_async_request(request)
            # As it came, maybe compressed: whoever asked decodes it.
            return response, b"".join([chunk async for chunk in response.aiter_raw()])

        response, content = self._portal.call(answer)
        return httpx.Response(response.status_code, headers=response.headers, content=content)


@contextlib.contextmanager
def served(app: FastAPI) -> Iterator[httpx.Client]:
    """A client of an application that is started and stopped as a server would."""
    with (
        anyio.from_thread.start_blocking_portal() as portal,
        portal.wrap_async_context_manager(app.router.lifespan_context(app)),
        httpx.Client(base_url="http://testserver", transport=InProcess(app, portal)) as client,
    ):
        yield client


@pytest.fixture
def client(app: FastAPI) -> Iterator[httpx.Client]:
    """A client of the application."""
    with served(app) as client:
        yield client


@pytest.fixture
def queue(redis: Redis, queue_settings: QueueSettings) -> JobQueue:
    """The application's queue, seen from outside."""
    return JobQueue(redis, queue_settings)


@pytest.fixture(scope="session")
def solved() -> bytes:
    """The compressed result of a real solve."""
    document = copy.deepcopy(FLEXIBLE_SPACECRAFT)
    document["problem"]["outputs"] = [{"name": "root_moment", "expression": "2*k*alpha"}]
    outcome = of_solution(solve(check_document(document)), "a job", 2**25)
    assert outcome.result is not None
    return outcome.result


@pytest.fixture
def job(store: JobStore) -> Callable[..., str]:
    """Make a job in any status, as if a worker had been at it; returns its id."""

    def make(
        status: JobStatus = JobStatus.QUEUED,
        result: bytes | None = None,
        document: bytes = json.dumps(FLEXIBLE_SPACECRAFT).encode(),
        **fields: Any,
    ) -> str:
        record = JobRecord(
            id=new_job_id(),
            status=JobStatus.QUEUED,
            method=fields.pop("method", "swcm"),
            max_seconds=60.0,
            created_at=time.time(),
            **fields,
        )
        store.add(record, document)
        if status is not JobStatus.QUEUED:
            owner = store.start(record.id).owner
            if status.final:
                assert store.finish(record.id, owner, status, result=result)
        return record.id

    return make


@pytest.fixture
def diverged(solved: bytes) -> bytes:
    """The compressed result of a solve whose last iterate is not finite: null for every number."""
    result = json.loads(zlib.decompress(solved))
    for part in ("coefficients", "nodes", "trajectory"):
        for group in ("states", "controls"):
            for name, values in result[part][group].items():
                result[part][group][name] = [None] * len(values)
    result["final_time"] = result["objective"] = None
    return compress(json.dumps(result).encode())
