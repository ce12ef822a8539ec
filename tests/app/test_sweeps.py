"""Sweeps over HTTP, without a worker."""

from __future__ import annotations

import csv
import io
import json
import zlib
from typing import Any

import httpx
import numpy as np
import pytest

from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.problems import problem
from worker.queue import JobQueue
from worker.records import JobStatus
from worker.store import JobStore

K = "/problem/model/parameters/k"


@pytest.fixture
def body(document: dict[str, Any]) -> dict[str, Any]:
    return {"document": document, "grid": {K: [90, 100, 110], "/name": ["=a", "b"]}}


def finish(store: JobStore, job_id: str, status: JobStatus, result: bytes | None = None) -> None:
    owner = store.start(job_id).owner
    assert store.finish(job_id, owner, status, result=result)


def test_a_sweep_becomes_a_job_for_each_point(
    client: httpx.Client, queue: JobQueue, body: dict[str, Any]
) -> None:
    response = client.post("/v1/sweeps", json=body)
    assert response.status_code == 202
    sweep = response.json()
    assert response.headers["location"] == sweep["links"]["self"] == f"/v1/sweeps/{sweep['id']}"
    assert (sweep["status"], sweep["points"], sweep["pointers"]) == ("queued", 6, [K, "/name"])
    assert sweep["counts"] == {"queued": 6, "running": 0, "succeeded": 0, "failed": 0, "cancelled": 0}
    assert [row["point"] for row in sweep["table"]] == [
        {K: k, "/name": name} for k in (90, 100, 110) for name in ("=a", "b")
    ]
    assert queue.depth() == 6
    job = client.get(sweep["table"][3]["href"]).json()
    assert (job["id"], job["name"], job["sweep"]) == (sweep["table"][3]["job"], "b", sweep["id"])
    spec = client.get(job["links"]["spec"]).json()
    assert spec["problem"]["model"]["parameters"]["k"] == 100
    short = client.get(sweep["links"]["self"], params={"table": 0}).json()
    assert short == {**sweep, "table": None}


def test_the_same_key_makes_one_sweep(client: httpx.Client, queue: JobQueue, body: dict[str, Any]) -> None:
    key = {"Idempotency-Key": "once"}
    first, second = (client.post("/v1/sweeps", json=body, headers=key) for _ in range(2))
    assert first.json()["id"] == second.json()["id"]
    assert queue.depth() == 6
    spaced = {"content": json.dumps(body, indent=2), "headers": key | {"Content-Type": "application/json"}}
    assert client.post("/v1/sweeps", **spaced).json()["id"] == first.json()["id"]
    # In another order its table would be another.
    backwards = body | {"grid": dict(reversed(body["grid"].items()))}
    for place, said in (("sweeps", backwards), ("jobs", body["document"])):
        problem(client.post(f"/v1/{place}", json=said, headers=key), 422, "key-reused")


def test_nothing_is_queued_of_a_sweep_with_a_mistake(
    client: httpx.Client, queue: JobQueue, store: JobStore, body: dict[str, Any]
) -> None:
    body["grid"][K][1] = "3*kk"
    members = problem(client.post("/v1/sweeps", json=body), 422, "invalid-document")
    assert members["errors"][0]["pointer"] == "/grid/~1problem~1model~1parameters~1k/1"
    assert queue.depth() == 0
    assert store.page(10) == ([], None)
    problem(
        client.post("/v1/sweeps", content=b"{", headers={"Content-Type": "application/json"}),
        422,
        "invalid-document",
    )
    problem(client.post("/v1/sweeps", content=b"{}"), 415, "unsupported-media-type")


def test_a_sweep_ends_with_partial_failures(
    client: httpx.Client, store: JobStore, body: dict[str, Any], solved: bytes
) -> None:
    sweep = client.post("/v1/sweeps", json=body).json()
    here, jobs = sweep["links"]["self"], [row["job"] for row in sweep["table"]]
    finish(store, jobs[0], JobStatus.SUCCEEDED, solved)
    assert client.get(here).json()["status"] == "running"
    for job_id in jobs[1:5]:
        finish(store, job_id, JobStatus.SUCCEEDED, solved)
    finish(store, jobs[5], JobStatus.FAILED)
    ended = client.get(here, params={"wait": 30}).json()
    assert (ended["status"], ended["counts"]["succeeded"], ended["counts"]["failed"]) == ("failed", 5, 1)
    assert ended["finished_at"] is not None
    result = json.loads(zlib.decompress(solved))
    row = ended["table"][0]
    assert row["objective"] == result["objective"]
    assert row["verification"]["terminal_error"] == result["verification"]["terminal_error"]
    assert ended["table"][5]["objective"] is None


def test_the_table_as_files(
    client: httpx.Client, store: JobStore, body: dict[str, Any], solved: bytes
) -> None:
    sweep = client.post("/v1/sweeps", json=body).json()
    jobs = [row["job"] for row in sweep["table"]]
    finish(store, jobs[0], JobStatus.SUCCEEDED, solved)
    finish(store, jobs[1], JobStatus.FAILED)
    result = json.loads(zlib.decompress(solved))
    text = client.get(sweep["links"]["csv"])
    assert text.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(text.text)))
    assert [row[K] for row in rows] == ["90", "90", "100", "100", "110", "110"]
    # A spreadsheet must not run it.
    assert {row["/name"] for row in rows} == {"'=a", "b"}
    assert float(rows[0]["objective"]) == result["objective"]
    assert (rows[1]["status"], rows[1]["objective"]) == ("failed", "")
    answer = client.get(sweep["links"]["npz"], params={"format": "npz", "nodes": 1, "trajectory": 1})
    with np.load(io.BytesIO(answer.content), allow_pickle=False) as arrays:
        assert arrays["problem.model.parameters.k"].tolist() == [90, 90, 100, 100, 110, 110]
        assert arrays["status"].tolist()[:3] == ["succeeded", "failed", "queued"]
        assert arrays["objective"][0] == result["objective"]
        assert np.isnan(arrays["objective"][1:]).all()
        assert (
            arrays["nodes.theta"][0].tolist()[: len(result["nodes"]["t"])]
            == result["nodes"]["states"]["theta"]
        )
        assert arrays["trajectory.T"].shape == (6, len(result["trajectory"]["t"]))
        assert np.isnan(arrays["trajectory.T"][1:]).all()
    with np.load(io.BytesIO(client.get(sweep["links"]["npz"]).content), allow_pickle=False) as arrays:
        assert not [name for name in arrays if name.startswith(("nodes", "trajectory"))]
    problem(client.get(sweep["links"]["npz"], params={"format": "mat"}), 406, "not-acceptable")


def test_all_are_cancelled(client: httpx.Client, queue: JobQueue, body: dict[str, Any]) -> None:
    sweep = client.post("/v1/sweeps", json=body).json()
    response = client.post(sweep["links"]["cancel"])
    assert response.status_code == 202
    assert (response.json()["status"], response.json()["counts"]["cancelled"]) == ("cancelled", 6)
    assert client.post(sweep["links"]["cancel"]).json() == response.json()


@pytest.mark.parametrize("path", ["", "/cancel", "/result"])
def test_an_unknown_sweep(client: httpx.Client, path: str) -> None:
    for unknown in ("nothing", "01a20748-a63b-7ec7-b324-a66bfbc20fd7"):
        ask = client.post if path == "/cancel" else client.get
        problem(ask(f"/v1/sweeps/{unknown}{path}"), 404, "not-found")


def test_a_start_that_is_not_there(client: httpx.Client, body: dict[str, Any]) -> None:
    body["grid"]["/warm_start"] = ["01a20748-a63b-7ec7-b324-a66bfbc20fd7"]
    members = problem(client.post("/v1/sweeps", json=body), 422, "invalid-document")
    assert members["errors"][0]["pointer"] == "/warm_start"


def test_the_document_of_the_tests_is_good(client: httpx.Client) -> None:
    assert client.post("/v1/validate", json=FLEXIBLE_SPACECRAFT).status_code == 200
