"""Limits that belong to a request rather than to a document: each is refused in words that name it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from app.client import Client
from tests.acceptance.conftest import Deployment, Document, wait_until
from tests.problems import problem
from worker.settings import QueueSettings


@pytest.fixture(scope="module")
def job_id(service: httpx.Client) -> str:
    from tests.bad_documents import FLEXIBLE_SPACECRAFT

    with Client(str(service.base_url)) as client:
        return str(client.solve(FLEXIBLE_SPACECRAFT)["job_id"])


@pytest.mark.parametrize(
    ("query", "parameter", "words"),
    [
        ("samples=20002", "samples", "at most 20,001, the limit"),
        ("samples=1", "samples", "at least 2"),
        ("samples=a", "samples", "whole number"),
        ("dt=0.0001", "dt", "20,001"),
        ("dt=1e-300", "dt", "20,001"),
        ("dt=-1", "dt", "greater than 0"),
        ("dt=nan", "dt", "finite"),
        ("t=" + ",".join(["1"] * 20_002), "t", "20,001"),
        ("t=1e9", "t", "outside"),
        ("t=1,,2", "t", "numbers"),
        ("t=nan", "t", "outside"),
        ("samples=5&dt=1", "samples", "only one"),
    ],
)
def test_samples(service: httpx.Client, job_id: str, query: str, parameter: str, words: str) -> None:
    response = service.get(f"/v1/jobs/{job_id}/trajectory?{query}")
    members = problem(response, 422, "invalid-request")
    assert members["errors"][0]["parameter"] == parameter
    assert words in members["detail"]


@pytest.mark.parametrize("query", ["samples=20001", "dt=0.002"])
def test_just_as_many_samples_as_are_allowed(service: httpx.Client, job_id: str, query: str) -> None:
    assert len(service.get(f"/v1/jobs/{job_id}/trajectory?{query}").json()["t"]) > 10_000


@pytest.mark.parametrize(
    ("query", "parameter"),
    [("limit=0", "limit"), ("limit=101", "limit"), ("status=done", "status"), ("cursor=x", "cursor")],
)
def test_lists(service: httpx.Client, query: str, parameter: str) -> None:
    members = problem(service.get(f"/v1/jobs?{query}"), 422, "invalid-request")
    assert members["errors"][0]["parameter"] == parameter


def test_points_of_a_sweep(service: httpx.Client, spacecraft: Document) -> None:
    body = {"document": spacecraft, "grid": {"/options/starts": {"from": 1, "to": 2, "count": 10_001}}}
    members = problem(service.post("/v1/sweeps", json=body), 422, "invalid-document")
    assert "10,000" in members["detail"]
    assert members["errors"][0]["type"] == "limit"
    body["grid"] = {"/a": list(range(200)), "/b": list(range(51))}
    assert "10,200" in problem(service.post("/v1/sweeps", json=body), 422, "invalid-document")["detail"]


def test_a_body_over_two_mebibytes(service: httpx.Client, spacecraft: Document) -> None:
    for path in ("/v1/jobs", "/v1/sweeps", "/v1/validate"):
        response = service.post(path, json={**spacecraft, "notes": "x" * 2**21})
        assert "2,097,152" in problem(response, 413, "too-large")["detail"]


def test_a_key_of_idempotency(service: httpx.Client, spacecraft: Document) -> None:
    for key in ("", "k" * 256):
        response = service.post("/v1/jobs", json=spacecraft, headers={"Idempotency-Key": key})
        members = problem(response, 422, "invalid-request")
        assert "255" in members["detail"]


@pytest.fixture
def crowded(broker: str, tmp_path: Path) -> Iterator[tuple[httpx.Client, httpx.Client]]:
    """Two API processes of a service without workers; at the first one two requests of a project may wait."""
    deployment = Deployment(QueueSettings(broker=broker, prefix="crowded:"), tmp_path)
    with deployment.api(ONDELETTE_PROJECT_WAITING="2") as client, deployment.api() as other:
        yield client, other


def test_streams_and_long_polls_beyond_what_may_wait(
    crowded: tuple[httpx.Client, httpx.Client], spacecraft: Document
) -> None:
    client, other = crowded
    path = client.post("/v1/jobs", json=spacecraft).headers["location"]
    with client.stream("GET", f"{path}/events") as one, client.stream("GET", f"{path}/events") as two:
        # Kept until the end: a stream whose iterator is gone is closed.
        streams = [stream.iter_lines() for stream in (one, two)]
        assert [next(lines) for lines in streams] == ["retry: 2000"] * 2
        for query in ("/events", "?wait=30"):
            refused = client.get(path + query)
            assert "2 requests of this project" in problem(refused, 429, "too-many-waiting")["detail"]
            assert int(refused.headers["retry-after"]) > 0
        assert client.get(path).status_code == 200
        accepted = client.post("/v1/jobs", json=spacecraft, headers={"Prefer": "wait=60"})
        assert (accepted.status_code, accepted.json()["status"]) == (202, "queued")
        assert "preference-applied" not in accepted.headers
        # Another process has seats of its own.
        assert other.get(f"{path}?wait=0.01").status_code == 200
    # Whoever hangs up gives his seat back.
    wait_until(lambda: client.get(f"{path}?wait=0.01").status_code == 200)
