"""What Prometheus reads, parsed by its own library."""

import time
from collections.abc import Callable

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from app.metrics import exposition
from tests.problems import problem
from worker.queue import JobQueue
from worker.reconciler import Reconciler
from worker.records import FailureType, JobError, JobRecord, JobStatus, new_job_id
from worker.store import JobStore

MakeJob = Callable[..., str]
Samples = dict[tuple[str, tuple[str, ...]], float]


def read(text: str) -> Samples:
    """The value of every sample by its name and its labels' values, in the order of the labels' names."""
    return {
        (sample.name, tuple(value for _, value in sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def scrape(client: httpx.Client) -> Samples:
    response = client.get("/metrics")
    assert response.status_code == 200
    assert response.headers["content-type"].startswith("text/plain")
    return read(response.text)


def test_a_service_that_has_done_nothing(client: httpx.Client) -> None:
    samples = scrape(client)
    assert set(samples.values()) == {0.0}
    assert ("ondelette_jobs_queued", ("normal",)) in samples
    assert ("ondelette_attempts_total", ()) in samples


def test_what_waits_runs_and_lives(job: MakeJob, queue: JobQueue, store: JobStore) -> None:
    record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time() - 100)
    store.add(record, b"{}")
    job()
    job(JobStatus.RUNNING)
    queue.enqueue(record)
    queue.beat("one@host", 3, 60)
    samples = read(exposition(store, queue).decode())
    assert samples["ondelette_jobs_queued", ("normal",)] == 2
    assert samples["ondelette_jobs_running", ()] == 1
    assert samples["ondelette_queue_messages", ()] == 1
    assert samples["ondelette_oldest_queued_seconds", ()] == pytest.approx(100, abs=5)
    assert (samples["ondelette_workers", ()], samples["ondelette_worker_slots", ()]) == (1, 3)


def test_jobs_that_have_ended(client: httpx.Client, job: MakeJob, store: JobStore) -> None:
    for _ in range(2):
        job(JobStatus.SUCCEEDED)
    store.cancel(job(method="gpm"))
    failed = job(method="gpm")
    store.start(failed)
    time.sleep(0.12)
    assert store.fail(failed, JobError(FailureType.INFEASIBLE, "Title.", "Detail."))
    samples = scrape(client)
    ended = {
        labels: value for (name, labels), value in samples.items() if name == "ondelette_jobs_ended_total"
    }
    assert ended == {
        ("swcm", "succeeded", "succeeded"): 2,
        ("gpm", "cancelled", "cancelled"): 1,
        ("gpm", "infeasible", "failed"): 1,
    }
    # A job that was cancelled before it was started took no time.
    counts = {
        labels: value for (name, labels), value in samples.items() if name == "ondelette_job_seconds_count"
    }
    assert counts == {("swcm", "succeeded"): 2, ("gpm", "infeasible"): 1}
    assert 0.12 <= samples["ondelette_job_seconds_sum", ("gpm", "infeasible")] < 1
    within = [
        samples["ondelette_job_seconds_bucket", (le, "gpm", "infeasible")] for le in ("0.1", "1", "+Inf")
    ]
    assert within == [0, 1, 1]


def test_what_went_wrong_on_the_way(job: MakeJob, store: JobStore, queue: JobQueue) -> None:
    job_id = job(JobStatus.RUNNING)
    assert store.start(job_id, redelivered=True) is None
    error = JobError(FailureType.TIME_LIMIT, "Title.", "Detail.")
    assert store.lose(job_id, "", 3_600, error)
    assert Reconciler(store, queue, silence=0.1).reclaim() == 1
    store.renew([(job_id, "tag", "worker/"), (new_job_id(), "tag", "worker/")])
    samples = read(exposition(store, queue).decode())
    assert {
        name.removeprefix("ondelette_").removesuffix("_total"): value
        for (name, labels), value in samples.items()
        if name.endswith("_total") and not labels
    } == {
        "attempts": 1,
        "redeliveries": 1,
        "duplicates": 1,
        "losses": 1,
        "lease_renewals": 2,
        "reclaimed": 1,
        "republished": 1,
        "reused": 0,
    }


def test_there_are_no_numbers_without_a_broker() -> None:
    from app.main import create_app
    from app.settings import Settings
    from tests.app.conftest import served

    with served(create_app(Settings(broker="unix:///nowhere/at/all.sock"))) as client:
        problem(client.get("/metrics"), 503, "unavailable")
