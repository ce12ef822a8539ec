"""What happens to jobs when the processes around them end."""

import os
import signal
import time
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.acceptance.conftest import Deployment, wait_until
from worker.settings import QueueSettings

Document = dict[str, Any]


@pytest.fixture
def own(broker: str, tmp_path: Path, request: pytest.FixtureRequest) -> Deployment:
    """A service of the test's own."""
    return Deployment(QueueSettings(broker=broker, prefix=f"{request.node.name}:"), tmp_path)


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


@linux
def test_a_job_whose_child_is_killed_is_solved_by_another(own: Deployment, spacecraft: Document) -> None:
    spacecraft["method"]["J"] = 8
    with own.worker(slots=1) as worker, own.api() as api:
        job_id = submit(api, spacecraft)
        wait_until(lambda: status(api, job_id) == "running")
        (child,) = children(worker.process.pid)
        os.kill(child, signal.SIGKILL)
        job = api.get(f"/v1/jobs/{job_id}", params={"wait": 60}).json()
        assert (job["status"], job["attempts"]) == ("succeeded", 2)


@linux
def test_a_job_that_kills_its_children_is_given_up(own: Deployment, long_job: Document) -> None:
    with own.worker(slots=1) as worker, own.api() as api:
        job_id = submit(api, long_job)
        for attempt in (1, 2):
            wait_until(
                lambda: (
                    (job := api.get(f"/v1/jobs/{job_id}").json())["status"] == "running"
                    and job["attempts"] == attempt  # noqa: B023  (called before it changes)
                )
            )
            (child,) = children(worker.process.pid)
            os.kill(child, signal.SIGKILL)
        job = api.get(f"/v1/jobs/{job_id}", params={"wait": 30}).json()
        assert (job["status"], job["attempts"], job["error"]["type"]) == ("failed", 2, "worker_lost")
        # The worker is as good as before.
        wait_until(lambda: api.get("/readyz").status_code == 200)


@linux
def test_a_child_that_does_not_answer_is_ended_at_the_hard_limit(own: Deployment, long_job: Document) -> None:
    long_job["options"]["max_seconds"] = 1
    with own.worker(slots=1) as worker, own.api(ONDELETTE_GRACE_SECONDS="1") as api:
        job_id = submit(api, long_job)
        wait_until(lambda: status(api, job_id) == "running")
        (child,) = children(worker.process.pid)
        os.kill(child, signal.SIGSTOP)
        job = api.get(f"/v1/jobs/{job_id}", params={"wait": 30}).json()
        assert (job["status"], job["error"]["type"], job["attempts"]) == ("failed", "time_limit", 1)
        assert api.get(f"/v1/jobs/{job_id}/result").status_code == 404


def test_a_worker_that_is_told_to_end_hands_its_job_back(own: Deployment, long_job: Document) -> None:
    with own.api() as api:
        with own.worker(slots=1, name="one", ONDELETTE_SHUTDOWN_SECONDS="0.3") as worker:
            running, waiting = submit(api, long_job), submit(api, long_job)
            wait_until(lambda: status(api, running) == "running")
            worker.process.send_signal(signal.SIGTERM)
            worker.process.wait(15)
        assert api.get("/readyz").status_code == 503
        for job_id in (running, waiting):
            job = api.get(f"/v1/jobs/{job_id}").json()
            assert (job["status"], job["started_at"], job["progress"]) == ("queued", None, None)
        with own.worker(slots=1, name="two"):
            job = api.get(f"/v1/jobs/{running}", params={"wait": 60}).json()
            assert (job["status"], job["attempts"]) == ("succeeded", 2)
            api.post(f"/v1/jobs/{waiting}/cancel")
            api.get(f"/v1/jobs/{waiting}", params={"wait": 60})


def test_a_worker_that_is_told_to_end_lets_a_short_job_end_first(
    own: Deployment, spacecraft: Document
) -> None:
    spacecraft["method"]["J"] = 8
    with own.api() as api, own.worker(slots=1, ONDELETTE_SHUTDOWN_SECONDS="10") as worker:
        job_id = submit(api, spacecraft)
        wait_until(lambda: status(api, job_id) == "running")
        worker.process.send_signal(signal.SIGTERM)
        job = api.get(f"/v1/jobs/{job_id}", params={"wait": 30}).json()
        assert (job["status"], job["attempts"]) == ("succeeded", 1)
        worker.process.wait(15)


def test_a_solve_that_needs_too_much_memory_fails_alone(own: Deployment, spacecraft: Document) -> None:
    small = spacecraft | {"method": {"name": "swcm"}}
    large = spacecraft | {"method": {"name": "hermite_simpson", "intervals": 30_000}}
    with own.worker(slots=1, ONDELETTE_MEMORY_MIB="700"), own.api() as api:
        job_id = submit(api, large)
        job = api.get(f"/v1/jobs/{job_id}", params={"wait": 60}).json()
        assert (job["status"], job["error"]["type"]) == ("failed", "out_of_memory")
        job = api.get(f"/v1/jobs/{submit(api, small)}", params={"wait": 30}).json()
        assert job["status"] == "succeeded"


def test_a_result_over_the_limit_fails_with_a_reason(own: Deployment, spacecraft: Document) -> None:
    with own.worker(slots=1, ONDELETTE_RESULT_MIB="0.01"), own.api() as api:
        job = api.get(f"/v1/jobs/{submit(api, spacecraft)}", params={"wait": 30}).json()
        assert job["status"] == "failed"
        assert "0.01 MiB" in job["error"]["detail"]


def test_jobs_wait_for_a_worker(own: Deployment, spacecraft: Document) -> None:
    with own.api() as api:
        assert api.get("/readyz").status_code == 503
        job_id = submit(api, spacecraft)
        began = time.monotonic()
        assert api.get(f"/v1/jobs/{job_id}", params={"wait": 0.3}).json()["status"] == "queued"
        assert time.monotonic() - began >= 0.3
        with own.worker(slots=1):
            assert api.get("/readyz").status_code == 200
            job = api.get(f"/v1/jobs/{job_id}", params={"wait": 30}).json()
            assert job["status"] == "succeeded"
