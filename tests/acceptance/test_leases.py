"""A worker that is killed, stopped or slow: its jobs are solved again exactly if it is lost."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.acceptance.conftest import SHORT, Deployment, Running, wait_until
from worker.settings import QueueSettings

Document = dict[str, Any]


@pytest.fixture(scope="module")
def own(broker: str, tmp_path_factory: pytest.TempPathFactory) -> Deployment:
    """A service of this file's own."""
    return Deployment(QueueSettings(broker=broker, prefix="leases:"), tmp_path_factory.mktemp("leases"))


@pytest.fixture(scope="module")
def api(own: Deployment) -> Iterator[httpx.Client]:
    """Its API."""
    with own.api(**SHORT) as client:
        yield client


@pytest.fixture(scope="module")
def pair(own: Deployment) -> Iterator[tuple[Running, Running]]:
    """Two workers that outlive what is done to them."""
    with own.worker(slots=1, name="one", **SHORT) as one, own.worker(slots=1, name="two", **SHORT) as two:
        yield one, two


@pytest.fixture
def slow_job(spacecraft: Document) -> Document:
    """A document that takes longer than a lease, and not for ever on a busy machine."""
    spacecraft["method"] = {"name": "swcm", "J": 11}
    spacecraft["options"] = {"max_seconds": 5}
    return spacecraft


def submit(api: httpx.Client, document: Document) -> str:
    response = api.post("/v1/jobs", json=document)
    assert response.status_code == 202, response.text
    job_id: str = response.json()["id"]
    return job_id


def linux_children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def read(api: httpx.Client, job_id: str) -> Document:
    job: Document = api.get(f"/v1/jobs/{job_id}").json()
    return job


def solving(pair: tuple[Running, Running], api: httpx.Client, job_id: str) -> Running:
    """Wait until a job runs; return the worker that is at it, which says so when everybody knows."""

    def at_it() -> list[Running]:
        return [worker for worker in pair if job_id in worker.log.read_text()]

    wait_until(lambda: read(api, job_id)["status"] == "running" and bool(at_it()))
    (found,) = at_it()
    return found


def attempts(api: httpx.Client, job_id: str) -> int:
    """Wait for the end of a job, by itself or by its time limit; return how often it was started."""
    job = api.get(f"/v1/jobs/{job_id}", params={"wait": 60}).json()
    assert job["status"] == "succeeded" or job["error"]["type"] == "time_limit", job
    count: int = job["attempts"]
    return count


def test_a_job_whose_worker_is_killed_is_solved_by_another(
    own: Deployment, api: httpx.Client, slow_job: Document, spacecraft: Document
) -> None:
    with own.worker(slots=1, name="first", **SHORT) as one:
        job_id = submit(api, slow_job)
        wait_until(lambda: read(api, job_id)["status"] == "running")
        # The second job is fetched already and waits inside the worker for its turn.
        waiting = submit(api, {**spacecraft, "method": {"name": "swcm"}})
        time.sleep(0.5)
        children = linux_children(one.process.pid)
        one.process.kill()
        with own.worker(slots=1, name="second", **SHORT):
            wait_until(lambda: read(api, job_id)["attempts"] == 2)
            assert attempts(api, waiting) == 1
            assert attempts(api, job_id) == 2
    # Nobody solves on for a worker that is not there any more.
    assert not [child for child in children if Path(f"/proc/{child}").exists()]


@pytest.mark.usefixtures("pair")
def test_a_slow_job_is_delivered_once(api: httpx.Client, slow_job: Document) -> None:
    job_id = submit(api, slow_job)
    began = time.monotonic()
    assert attempts(api, job_id) == 1
    assert time.monotonic() - began > 3


def test_a_worker_whose_main_process_alone_is_stopped_keeps_its_job(
    pair: tuple[Running, Running], api: httpx.Client, slow_job: Document
) -> None:
    """Its child goes on solving, and says so."""
    job_id = submit(api, slow_job)
    worker = solving(pair, api, job_id)
    os.kill(worker.process.pid, signal.SIGSTOP)
    assert attempts(api, job_id) == 1
    os.kill(worker.process.pid, signal.SIGCONT)


def test_a_worker_that_was_only_stopped_does_not_disturb_its_successor(
    pair: tuple[Running, Running], api: httpx.Client, slow_job: Document
) -> None:
    job_id = submit(api, slow_job)
    worker = solving(pair, api, job_id)
    stopped = [worker.process.pid, *linux_children(worker.process.pid)]
    for pid in stopped:
        os.kill(pid, signal.SIGSTOP)
    wait_until(lambda: read(api, job_id)["attempts"] == 2)
    for pid in stopped:
        os.kill(pid, signal.SIGCONT)
    assert attempts(api, job_id) == 2
    job = read(api, job_id)
    # The first worker is whole again, and leaves the job alone from now on.
    wait_until(lambda: len(api.get("/readyz").json()["workers"]) == 2)
    assert read(api, job_id) == job
