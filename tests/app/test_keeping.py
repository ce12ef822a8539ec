"""How long jobs are kept, and answers that are given again."""

import time
from collections.abc import Callable
from datetime import datetime
from typing import Any

import httpx
import pytest
from redis import Redis

from app.main import create_app
from app.settings import Settings
from solvers.solve import solve
from solvers.spec import check_document
from tests.acceptance.conftest import wait_until
from tests.app.conftest import served
from tests.problems import problem
from worker.outcome import Outcome, of_solution
from worker.priorities import queue_of
from worker.queue import JobQueue
from worker.records import JobStatus, Priority
from worker.settings import QueueSettings
from worker.store import JobStore

Make = Callable[..., str]
Document = dict[str, Any]


def days(job: Document) -> float:
    """How long an ended job is kept, in days."""
    kept = datetime.fromisoformat(job["expires_at"]) - datetime.fromisoformat(job["finished_at"])
    return kept.total_seconds() / 86_400


def test_an_ended_job_says_until_when_it_is_kept(client: httpx.Client, job: Make) -> None:
    active = client.get(f"/v1/jobs/{job(JobStatus.RUNNING)}").json()
    assert (active["expires_at"], active["pinned"]) == (None, False)
    assert days(client.get(f"/v1/jobs/{job(JobStatus.SUCCEEDED)}").json()) == pytest.approx(30, abs=1e-3)


@pytest.mark.parametrize("when", [JobStatus.QUEUED, JobStatus.RUNNING, JobStatus.SUCCEEDED])
def test_a_pinned_job_is_kept_until_it_is_let_go(
    client: httpx.Client, job: Make, store: JobStore, when: JobStatus, solved: bytes
) -> None:
    job_id = job(when, solved if when.final else None)
    before = client.get(f"/v1/jobs/{job_id}")
    pinned = client.post(f"/v1/jobs/{job_id}/pin")
    assert (pinned.status_code, pinned.json()["pinned"]) == (200, True)
    assert pinned.headers["etag"] != before.headers["etag"]
    again = client.post(f"/v1/jobs/{job_id}/pin")
    assert again.headers["etag"] == pinned.headers["etag"]
    if when is JobStatus.QUEUED:
        store.cancel(job_id)
    elif when is JobStatus.RUNNING:
        assert store.fail(job_id, _error())
    ended = client.get(f"/v1/jobs/{job_id}").json()
    assert (ended["expires_at"], ended["pinned"]) == (None, True)
    parts = store._keys(job_id)[:3]
    assert all(store.redis.ttl(part) < 0 for part in parts)
    let_go = client.delete(f"/v1/jobs/{job_id}/pin").json()
    assert not let_go["pinned"]
    assert days(let_go) == pytest.approx(30, abs=1e-3)
    assert store.redis.ttl(parts[0]) > 29 * 86_400


def test_a_pinned_job_can_be_erased(client: httpx.Client, job: Make) -> None:
    job_id = job(JobStatus.SUCCEEDED)
    client.post(f"/v1/jobs/{job_id}/pin")
    assert client.delete(f"/v1/jobs/{job_id}").status_code == 204
    problem(client.get(f"/v1/jobs/{job_id}"), 410, "gone")


def _error() -> Any:
    from worker.records import FailureType, JobError

    return JobError(FailureType.INTERNAL, "Title.", "Detail.")


class TestReuse:
    @pytest.fixture
    def answered(self, client: httpx.Client, store: JobStore, document: Document) -> str:
        """The id of a job that a worker has solved."""
        job_id: str = client.post("/v1/jobs", json=document).json()["id"]
        end(store, job_id, of_solution(solve(check_document(document)), job_id, 2**25))
        return job_id

    def test_the_same_question_is_answered_at_once(
        self, client: httpx.Client, answered: str, document: Document, queue: JobQueue
    ) -> None:
        waiting = queue.depth()
        same = {**document, "name": "again", "tags": ["other"], "priority": "high", "reuse": True}
        same["problem"] = dict(reversed(same["problem"].items()))
        same["options"] = {"tolerance": 1.0e-8}
        response = client.post("/v1/jobs", json=same)
        job = response.json()
        assert response.status_code == 202
        assert (job["status"], job["reused_from"], job["attempts"]) == ("succeeded", answered, 0)
        assert (job["name"], job["started_at"]) == ("again", None)
        assert job["id"] != answered
        assert queue.depth() == waiting
        first = client.get(f"/v1/jobs/{answered}/result").json()
        second = client.get(f"/v1/jobs/{job['id']}/result").json()
        assert (second["job_id"], second["reused_from"]) == (job["id"], answered)
        assert second["resolved"]["document"]["name"] == "again"
        for key in ("objective", "nodes", "trajectory", "verification", "provenance"):
            assert second[key] == first[key]

    @pytest.mark.parametrize(
        "change",
        [
            {"reuse": False},
            {"options": {"tolerance": 1e-7}},
            {"output": {"samples": 11}},
            {"method": {"name": "swcm", "J": 3}},
        ],
        ids=lambda change: next(iter(change)),
    )
    def test_another_question_is_solved(
        self, client: httpx.Client, answered: str, document: Document, change: Document
    ) -> None:
        job = client.post("/v1/jobs", json={**document, "reuse": True, **change}).json()
        assert (job["status"], job["reused_from"]) == ("queued", None)

    def test_what_failed_or_is_erased_is_solved_again(
        self, client: httpx.Client, answered: str, store: JobStore, document: Document
    ) -> None:
        client.delete(f"/v1/jobs/{answered}")
        asked = {**document, "reuse": True}
        job = client.post("/v1/jobs", json=asked).json()
        assert job["status"] == "queued"
        failed = {**asked, "options": {"max_iterations": 2}}
        job_id = client.post("/v1/jobs", json=failed).json()["id"]
        end(store, job_id, of_solution(solve(check_document(failed)), job_id, 2**25))
        assert client.get(f"/v1/jobs/{job_id}").json()["status"] == "failed"
        assert client.post("/v1/jobs", json=failed).json()["status"] == "queued"

    def test_a_key_makes_one_job_of_it(self, client: httpx.Client, answered: str, document: Document) -> None:
        asked = {**document, "reuse": True}
        jobs = [
            client.post(
                "/v1/jobs", json=asked, headers={"Idempotency-Key": f"key {time.time_ns() // 10**12}"}
            )
            for _ in range(2)
        ]
        assert jobs[0].json() == jobs[1].json()
        assert jobs[0].json()["reused_from"] == answered


def end(store: JobStore, job_id: str, outcome: Outcome) -> None:
    """Write the end of a job as a worker does."""
    owner = store.start(job_id).owner
    assert store.finish(job_id, owner, outcome.status, outcome.error, outcome.result, outcome.digest)


def test_jobs_are_looked_after_again_when_that_has_failed(
    queue_settings: QueueSettings, job: Make, queue: JobQueue, redis: Redis, caplog: pytest.LogCaptureFixture
) -> None:
    settings = Settings(broker=queue_settings.broker, prefix=queue_settings.prefix, reconcile_seconds=0.02)
    waiting = f"{queue_settings.prefix}{queue_of(Priority.NORMAL)}"
    # A message of somebody else's, which nobody can read; and a job that has none.
    redis.lpush(waiting, b"nonsense")
    job()
    with served(create_app(settings)):
        wait_until(lambda: "looking after jobs has failed" in caplog.text)
        redis.delete(waiting)
        wait_until(lambda: queue.depth() == 1)
