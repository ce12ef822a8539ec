"""Whose turn it is: priorities, and jobs that nobody waits for any more."""

import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import httpx
import pytest

from tests.acceptance.conftest import wait_until
from worker.queue import JobQueue

Document = dict[str, Any]


def submit(api: httpx.Client, document: Document, **keys: Any) -> str:
    response = api.post("/v1/jobs", json=document | keys)
    assert response.status_code == 202, response.text
    job_id: str = response.json()["id"]
    return job_id


def runs(api: httpx.Client, job_id: str) -> bool:
    return bool(api.get(f"/v1/jobs/{job_id}").json()["status"] == "running")


def cancel(api: httpx.Client, ids: list[str]) -> None:
    for job_id in ids:
        api.post(f"/v1/jobs/{job_id}/cancel")


def final(api: httpx.Client, job_id: str) -> Document:
    job: Document = api.get(f"/v1/jobs/{job_id}", params={"wait": 60}).json()
    return job


@pytest.fixture
def busy(service: httpx.Client, long_job: Document, shared_queue: JobQueue) -> Iterator[list[str]]:
    """Two jobs that keep both slots of the worker busy until they are cancelled; nothing else is queued."""
    # Messages of jobs that were cancelled while they waited have their turns too.
    wait_until(lambda: shared_queue.depth() == 0)
    ids = [submit(service, long_job) for _ in range(2)]
    for job_id in ids:
        wait_until(partial(runs, service, job_id))
    yield ids
    cancel(service, ids)
    for job_id in ids:
        final(service, job_id)


def test_urgent_jobs_are_started_first_and_the_others_in_between(
    service: httpx.Client, busy: list[str], spacecraft: Document
) -> None:
    waiting = {"low": 4, "normal": 4, "high": 12}
    ids = [
        submit(service, spacecraft, priority=priority, options={"max_iterations": 1})
        for priority, number in waiting.items()
        for _ in range(number)
    ]
    cancel(service, busy)
    jobs = sorted((final(service, job_id) for job_id in ids), key=lambda job: job["started_at"])
    order = [job["priority"] for job in jobs]
    ranks = {
        name: [rank for rank, each in enumerate(order) if each == name] for name in ("high", "normal", "low")
    }
    assert sum(ranks["high"][:4]) < sum(ranks["normal"]) < sum(ranks["low"])
    assert ranks["low"][0] < ranks["high"][-1]


@pytest.mark.usefixtures("busy")
def test_a_job_whose_deadline_passes_while_it_waits_never_starts(
    service: httpx.Client, spacecraft: Document
) -> None:
    began = time.monotonic()
    job_id = submit(service, spacecraft, deadline_seconds=1)
    job = final(service, job_id)
    assert 0.9 < time.monotonic() - began < 4
    assert (job["status"], job["error"]["type"], job["attempts"]) == ("failed", "time_limit", 0)
    assert job["deadline_at"] <= job["finished_at"]
    assert service.get(f"/v1/jobs/{job_id}/result").status_code == 404


def test_a_solve_ends_at_its_deadline_and_its_last_iterate_is_kept(
    service: httpx.Client, long_job: Document
) -> None:
    job_id = submit(service, long_job, deadline_seconds="4/2")
    job = final(service, job_id)
    assert (job["status"], job["error"]["type"], job["attempts"]) == ("failed", "time_limit", 1)
    result = service.get(f"/v1/jobs/{job_id}/result").json()
    assert (result["status"], result["success"]) == ("time_limit", False)
    assert result["resolved"]["document"]["deadline_seconds"] == 2
    assert result["resolved"]["document"]["options"]["max_seconds"] == 60
