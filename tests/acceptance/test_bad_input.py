"""Bad input over HTTP: each is refused in the contract's words, and none of it leaves a trace."""

import itertools
import os
import time
from collections.abc import Iterator

import httpx
import pytest

from tests.bad_documents import BAD_DOCUMENTS, OVERSIZED_BYTES, BadDocument, oversized_body
from tests.problems import problem
from worker.queue import JobQueue
from worker.store import JobStore

JSON = {"Content-Type": "application/json"}


@pytest.fixture
def untouched(service: httpx.Client, shared_store: JobStore, shared_queue: JobQueue) -> Iterator[None]:
    """Holds if the test leaves no record, no message and a service that answers."""

    def state() -> tuple[int, int]:
        records, _ = shared_store.page(10_000)
        return len(records), shared_queue.depth()

    before = state()
    yield
    assert state() == before
    assert service.get("/readyz").status_code == 200


@pytest.mark.usefixtures("untouched")
@pytest.mark.parametrize("path", ["/v1/jobs", "/v1/validate"])
@pytest.mark.parametrize("bad", BAD_DOCUMENTS, ids=lambda bad: bad.name)
def test_a_bad_document_is_refused_where_its_fault_is(
    service: httpx.Client, bad: BadDocument, path: str
) -> None:
    began = time.monotonic()
    response = service.post(path, content=bad.raw, headers=JSON)
    members = problem(response, 422, "unsupported" if bad.type == "unsupported" else "invalid-document")
    assert time.monotonic() - began < 2
    assert 1 <= len(members["errors"]) <= 50
    found = [error for error in members["errors"] if bad.pointer in (None, error["pointer"])]
    assert found, members["errors"]
    assert bad.type in {error["type"] for error in found}
    assert all(error["detail"] for error in found)
    # What was sent is not sent back.
    assert len(response.content) < 20_000


@pytest.mark.usefixtures("untouched")
def test_a_body_of_60_mb_with_its_length(service: httpx.Client) -> None:
    headers = {**JSON, "Content-Length": str(OVERSIZED_BYTES)}
    response = service.post("/v1/jobs", content=oversized_body(), headers=headers)
    assert "2,097,152" in problem(response, 413, "too-large")["detail"]


@pytest.mark.usefixtures("untouched")
def test_a_body_of_60_mb_in_chunks(service: httpx.Client) -> None:
    response = service.post("/v1/jobs", content=oversized_body(), headers=JSON)
    assert response.request.headers["transfer-encoding"] == "chunked"
    problem(response, 413, "too-large")


@pytest.mark.usefixtures("untouched")
def test_noise(service: httpx.Client) -> None:
    for size in (1, 10, 1_000, 100_000):
        response = service.post("/v1/jobs", content=os.urandom(size), headers=JSON)
        problem(response, 422, "invalid-document")


@pytest.mark.usefixtures("untouched")
def test_a_good_document_cut_off_anywhere(service: httpx.Client) -> None:
    import json

    from tests.bad_documents import FLEXIBLE_SPACECRAFT

    whole = json.dumps(FLEXIBLE_SPACECRAFT).encode()
    for end in itertools.chain(range(0, len(whole) - 1, 37), [len(whole) - 1]):
        response = service.post("/v1/jobs", content=whole[:end], headers=JSON)
        problem(response, 422, "invalid-document")
