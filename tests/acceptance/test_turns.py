"""Whose turn it is: priorities, and jobs that nobody waits for any more."""

import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests.acceptance.conftest import Deployment, wait_until
from worker.settings import QueueSettings

Document = dict[str, Any]


@pytest.fixture(scope="module")
def api(broker: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """The API of a worker that solves one job at a time."""
    deployment = Deployment(QueueSettings(broker=broker, prefix="turns:"), tmp_path_factory.mktemp("turns"))
    with deployment.worker(slots=1), deployment.api() as api:
        yield api


def submit(api: httpx.Client, document: Document, **keys: Any) -> str:
    response = api.post("/v1/jobs", json=document | keys)
    assert response.status_code == 202, response.text
    job_id: str = response.json()["id"]
    return job_id


def final(api: httpx.Client, job_id: str) -> Document:
    job: Document = api.get(f"/v1/jobs/{job_id}", params={"wait": 60}).json()
    return job


@pytest.fixture
def busy(api: httpx.Client, long_job: Document) -> Iterator[str]:
    """A job that keeps the worker busy until it is cancelled."""
    job_id = submit(api, long_job)
    wait_until(lambda: api.get(f"/v1/jobs/{job_id}").json()["status"] == "running")
    yield job_id
    api.post(f"/v1/jobs/{job_id}/cancel")
    final(api, job_id)


def test_urgent_jobs_are_started_first_and_the_others_in_between(
    api: httpx.Client, busy: str, spacecraft: Document
) -> None:
    ids = [
        submit(api, spacecraft, priority=priority, options={"max_iterations": 1})
        for priority in ("low", "normal", "high")
        for _ in range(4)
    ]
    api.post(f"/v1/jobs/{busy}/cancel")
    jobs = sorted((final(api, job_id) for job_id in ids), key=lambda job: job["started_at"])
    order = [job["priority"] for job in jobs]
    ranks = {
        name: sum(rank for rank, each in enumerate(order) if each == name)
        for name in ("low", "normal", "high")
    }
    assert ranks["high"] < ranks["normal"] < ranks["low"]
    assert "low" in order[:8]


def test_a_job_whose_deadline_passes_while_it_waits_never_starts(
    api: httpx.Client, busy: str, spacecraft: Document
) -> None:
    began = time.monotonic()
    job_id = submit(api, spacecraft, deadline_seconds=1)
    job = final(api, job_id)
    assert 0.9 < time.monotonic() - began < 4
    assert (job["status"], job["error"]["type"], job["attempts"]) == ("failed", "time_limit", 0)
    assert job["deadline_at"] <= job["finished_at"]
    assert api.get(f"/v1/jobs/{job_id}/result").status_code == 404


def test_a_solve_ends_at_its_deadline_and_its_last_iterate_is_kept(
    api: httpx.Client, long_job: Document
) -> None:
    job_id = submit(api, long_job, deadline_seconds="4/2")
    job = final(api, job_id)
    assert (job["status"], job["error"]["type"], job["attempts"]) == ("failed", "time_limit", 1)
    result = api.get(f"/v1/jobs/{job_id}/result").json()
    assert (result["status"], result["success"]) == ("time_limit", False)
    assert result["resolved"]["document"]["deadline_seconds"] == 2
    assert result["resolved"]["document"]["options"]["max_seconds"] == 60
