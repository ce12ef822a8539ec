"""Limits that belong to a request rather than to a document: each is refused in words that name it."""

from __future__ import annotations

import httpx
import pytest

from app.client import Client
from tests.acceptance.conftest import Document
from tests.problems import problem


@pytest.fixture(scope="module")
def job_id(service: httpx.Client) -> str:
    from tests.bad_documents import FLEXIBLE_SPACECRAFT

    with Client(str(service.base_url)) as client:
        return str(client.solve(FLEXIBLE_SPACECRAFT)["job_id"])


@pytest.mark.parametrize(
    ("query", "parameter", "words"),
    [
        ("samples=20002", "samples", "20001"),
        ("samples=1", "samples", "2"),
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
