"""What happens to jobs when the processes around them end."""

import os
import signal
import time
from collections.abc import Iterator
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.acceptance.conftest import Deployment, Running, wait_until
from worker.settings import QueueSettings

Document = dict[str, Any]

# What a solve may take beyond its max_seconds, and what its process may take besides to store its answer.
LIMITS = {"ONDELETTE_GRACE_SECONDS": "1", "ONDELETTE_OUTAGE_SECONDS": "2"}


@pytest.fixture(scope="module")
def own(broker: str, tmp_path_factory: pytest.TempPathFactory) -> Deployment:
    """A service whose workers each test starts for itself."""
    return Deployment(QueueSettings(broker=broker, prefix="own:"), tmp_path_factory.mktemp("own"))


@pytest.fixture(scope="module")
def own_api(own: Deployment) -> Iterator[httpx.Client]:
    """Its API."""
    with own.api() as api:
        yield api


@pytest.fixture(scope="module")
def worker_and_api(
    broker: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Running, httpx.Client]]:
    """A worker that solves one job at a time and outlives what is done to its children, and its API."""
    deployment = Deployment(QueueSettings(broker=broker, prefix="faults:"), tmp_path_factory.mktemp("faults"))
    # Each child solves one job only: how it is replaced is part of what is looked at.
    with deployment.both(slots=1, ONDELETTE_TASKS_PER_CHILD="1", **LIMITS) as both:
        yield both


def submit(api: httpx.Client, document: Document) -> str:
    response = api.post("/v1/jobs", json=document)
    assert response.status_code == 202, response.text
    job_id: str = response.json()["id"]
    return job_id


def status(api: httpx.Client, job_id: str) -> str:
    word: str = api.get(f"/v1/jobs/{job_id}").json()["status"]
    return word


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


linux = pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="finds the worker's children in /proc"
)


def test_a_child_that_has_solved_its_share_is_replaced_at_once(
    worker_and_api: tuple[Running, httpx.Client], spacecraft: Document
) -> None:
    """Celery would look for its end on a timer of five seconds only."""
    _, api = worker_and_api
    spacecraft["options"]["max_iterations"] = 1
    ids = [submit(api, spacecraft) for _ in range(4)]
    jobs = [api.get(f"/v1/jobs/{job_id}", params={"wait": 60}).json() for job_id in ids]
    ended = [datetime.fromisoformat(job["finished_at"]) for job in jobs[:-1]]
    began = [datetime.fromisoformat(job["started_at"]) for job in jobs[1:]]
    assert min(after - before for before, after in zip(ended, began, strict=True)) < timedelta(seconds=3)


@linux
def test_a_job_whose_child_is_killed_is_solved_by_another(
    worker_and_api: tuple[Running, httpx.Client], spacecraft: Document
) -> None:
    worker, api = worker_and_api
    spacecraft["method"]["J"] = 8
    job_id = submit(api, spacecraft)
    wait_until(lambda: status(api, job_id) == "running")
    (child,) = children(worker.process.pid)
    os.kill(child, signal.SIGKILL)
    job = api.get(f"/v1/jobs/{job_id}", params={"wait": 60}).json()
    assert (job["status"], job["attempts"]) == ("succeeded", 2)


@linux
def test_a_job_whose_child_aborts_itself_is_not_tried_again(
    worker_and_api: tuple[Running, httpx.Client], long_job: Document
) -> None:
    """C++ code that finds no memory, at a place where it cannot say so, ends its process."""
    worker, api = worker_and_api
    job_id = submit(api, long_job)
    wait_until(lambda: status(api, job_id) == "running")
    (child,) = children(worker.process.pid)
    os.kill(child, signal.SIGABRT)
    job = api.get(f"/v1/jobs/{job_id}", params={"wait": 30}).json()
    assert (job["status"], job["attempts"], job["error"]["type"]) == ("failed", 1, "out_of_memory")


@linux
def test_a_job_that_kills_its_children_is_given_up(
    worker_and_api: tuple[Running, httpx.Client], long_job: Document
) -> None:
    worker, api = worker_and_api
    job_id = submit(api, long_job)

    def started(attempt: int) -> bool:
        job = api.get(f"/v1/jobs/{job_id}").json()
        return bool(job["status"] == "running" and job["attempts"] == attempt)

    for attempt in (1, 2):
        wait_until(partial(started, attempt))
        (child,) = children(worker.process.pid)
        os.kill(child, signal.SIGKILL)
    job = api.get(f"/v1/jobs/{job_id}", params={"wait": 30}).json()
    assert (job["status"], job["attempts"], job["error"]["type"]) == ("failed", 2, "worker_lost")


@linux
@pytest.mark.parametrize("goes_on", [True, False])
def test_a_child_that_does_not_answer_is_ended_at_its_limit(
    worker_and_api: tuple[Running, httpx.Client], long_job: Document, goes_on: bool
) -> None:
    """By itself as soon as it runs again, else by the worker."""
    worker, api = worker_and_api
    long_job["options"]["max_seconds"] = 1
    job_id = submit(api, long_job)
    wait_until(lambda: status(api, job_id) == "running")
    (child,) = children(worker.process.pid)
    os.kill(child, signal.SIGSTOP)
    if goes_on:
        time.sleep(2.5)
        os.kill(child, signal.SIGCONT)
    job = api.get(f"/v1/jobs/{job_id}", params={"wait": 30}).json()
    assert (job["status"], job["error"]["type"], job["attempts"]) == ("failed", "time_limit", 1)
    assert api.get(f"/v1/jobs/{job_id}/result").status_code == 404


def test_a_worker_that_is_told_to_end_hands_its_job_back_or_lets_a_short_one_end_first(
    own: Deployment, own_api: httpx.Client, spacecraft: Document
) -> None:
    api = own_api
    spacecraft["method"]["J"] = 9
    # Without a worker the service is not ready, but takes jobs.
    assert api.get("/readyz").status_code == 503
    running, waiting = submit(api, spacecraft), submit(api, spacecraft)
    with own.worker(slots=1, name="hasty", ONDELETTE_SHUTDOWN_SECONDS="0.1") as worker:
        assert api.get("/readyz").status_code == 200
        wait_until(lambda: status(api, running) == "running")
        worker.process.send_signal(signal.SIGTERM)
        worker.process.wait(15)
    assert api.get("/readyz").status_code == 503
    for job_id in (running, waiting):
        job = api.get(f"/v1/jobs/{job_id}").json()
        assert (job["status"], job["started_at"], job["progress"]) == ("queued", None, None)
    api.post(f"/v1/jobs/{waiting}/cancel")
    with own.worker(slots=1, name="patient", ONDELETTE_SHUTDOWN_SECONDS="60") as worker:
        wait_until(lambda: status(api, running) == "running")
        worker.process.send_signal(signal.SIGTERM)
        job = api.get(f"/v1/jobs/{running}", params={"wait": 60}).json()
        assert (job["status"], job["attempts"]) == ("succeeded", 2)
        # It ends with its last job, long before its time is over.
        worker.process.wait(15)


def test_a_solve_that_needs_too_much_fails_alone(
    own: Deployment, own_api: httpx.Client, spacecraft: Document
) -> None:
    with own.worker(slots=1, name="small", ONDELETTE_MEMORY_MIB="1000", ONDELETTE_RESULT_MIB="0.06"):

        def end(method: Document) -> Document:
            job_id = submit(own_api, spacecraft | {"method": method})
            job: Document = own_api.get(f"/v1/jobs/{job_id}", params={"wait": 60}).json()
            return job

        job = end({"name": "hermite_simpson", "intervals": 30_000})
        assert (job["status"], job["error"]["type"]) == ("failed", "out_of_memory")
        job = end({"name": "swcm", "J": 8})
        assert job["status"] == "failed"
        assert "the limit is 0.06 MiB" in job["error"]["detail"]
        assert end({"name": "swcm"})["status"] == "succeeded"
