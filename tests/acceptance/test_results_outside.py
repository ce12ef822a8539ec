"""Results in a folder, with a real worker and a real API: read, waited for, lost and erased."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from tests.acceptance.conftest import Deployment, Document, wait_until
from tests.problems import problem
from worker.settings import QueueSettings


@pytest.fixture
def outside(broker: str, folder: Path, tmp_path: Path) -> Iterator[httpx.Client]:
    """A service that keeps its results in ``folder``."""
    deployment = Deployment(QueueSettings(broker=broker, prefix="outside:"), tmp_path)
    with deployment.both(slots=1, ONDELETTE_RESULTS=f"file://{folder}") as (_, client):
        yield client


def test_results_in_a_folder(outside: httpx.Client, folder: Path, spacecraft: Document) -> None:
    def solved(document: Document) -> Document:
        job: Document = outside.post("/v1/jobs", json=document, headers={"Prefer": "wait=60"}).json()
        assert job["status"] == "succeeded", job
        return job

    first = solved(spacecraft)["id"]
    result = outside.get(f"/v1/jobs/{first}/result").json()
    assert result["objective"] == pytest.approx(25.8661, abs=0.05)
    assert [file.name.partition(".")[0] for file in folder.iterdir()] == [first]
    assert outside.get(f"/v1/jobs/{first}/trajectory?samples=3").status_code == 200
    assert outside.get(f"/v1/jobs/{first}/bundle.zip").status_code == 200

    away = folder.rename(folder.with_name("unmounted"))
    refused = outside.get(f"/v1/jobs/{first}/result")
    assert "results" in problem(refused, 503, "unavailable")["detail"]
    assert int(refused.headers["retry-after"]) > 0
    # What cannot be answered from the folder is solved; its worker waits with the answer.
    second = outside.post("/v1/jobs", json={**spacecraft, "reuse": True}).json()["id"]
    wait_until(lambda: outside.get(f"/v1/jobs/{second}").json()["status"] == "running")
    assert outside.get(f"/v1/jobs/{second}?wait=2").json()["status"] == "running"
    away.rename(folder)
    assert outside.get(f"/v1/jobs/{second}?wait=60").json()["status"] == "succeeded"
    third = solved({**spacecraft, "reuse": True})
    assert third["reused_from"] == second

    held = {file.name.partition(".")[0]: file for file in folder.iterdir()}
    assert held.keys() == {first, second, third["id"]}
    assert outside.delete(f"/v1/jobs/{first}").status_code == 204
    assert not held[first].exists()
    problem(outside.get(f"/v1/jobs/{first}/result"), 410, "gone")
    held[second].unlink()
    problem(outside.get(f"/v1/jobs/{second}/result"), 404, "result-lost")
    refused = outside.post("/v1/jobs", json={**spacecraft, "warm_start": second})
    assert problem(refused, 422, "invalid-document")["errors"][0]["pointer"] == "/warm_start"
    assert json.loads(outside.get(f"/v1/jobs/{second}/spec").content)["problem"] == spacecraft["problem"]
