"""Jobs that nobody works on are found, and those that somebody works on are left alone."""

import json
import time
from typing import Any, cast

import pytest
from redis import Redis

from worker.outcome import TIMED_OUT
from worker.priorities import queue_of
from worker.queue import JobQueue
from worker.reconciler import Reconciler
from worker.records import FailureType, JobRecord, JobStatus, Priority, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore


@pytest.fixture
def queue(redis: Redis, queue_settings: QueueSettings) -> JobQueue:
    return JobQueue(redis, queue_settings)


@pytest.fixture
def reconciler(store: JobStore, queue: JobQueue) -> Reconciler:
    return Reconciler(store, queue, silence=0.2, settle=5.0)


QUEUE = queue_of(Priority.NORMAL)


def add(store: JobStore, age: float = 60.0, **fields: Any) -> str:
    record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time() - age, **fields)
    store.add(record, b"{}")
    return record.id


def waiting(redis: Redis, settings: QueueSettings) -> list[str]:
    """The jobs in the queue, next one first."""
    texts = cast(list[bytes], redis.lrange(f"{settings.prefix}{QUEUE}", 0, -1))
    return [json.loads(text)["headers"]["id"] for text in reversed(texts)]


def fetch(redis: Redis, settings: QueueSettings) -> None:
    """Take the next message and note it, as a worker does."""
    text = cast(bytes, redis.rpop(f"{settings.prefix}{QUEUE}"))
    redis.hset(f"{settings.prefix}unacked", "tag", json.dumps([json.loads(text), "", QUEUE]))


def test_a_job_without_a_message_is_published_once(
    store: JobStore, reconciler: Reconciler, redis: Redis, queue_settings: QueueSettings
) -> None:
    job_id = add(store)
    assert [reconciler.republish() for _ in range(3)] == [1, 0, 0]
    assert waiting(redis, queue_settings) == [job_id]


def test_a_job_that_has_just_been_taken_may_still_get_its_message(
    store: JobStore, reconciler: Reconciler
) -> None:
    add(store, age=1.0)
    assert reconciler.republish() == 0


def test_a_queue_that_is_lost_is_filled_again(
    store: JobStore, queue: JobQueue, redis: Redis, queue_settings: QueueSettings
) -> None:
    reconciler = Reconciler(store, queue, silence=0.2, settle=1.0)
    jobs = [add(store, age=0.0) for _ in range(5)]
    for job_id in jobs:
        queue.enqueue(store.get(job_id))
    time.sleep(1.2)
    assert reconciler.republish() == 0
    redis.delete(f"{queue_settings.prefix}{QUEUE}")
    assert reconciler.republish() == 5
    assert sorted(waiting(redis, queue_settings)) == sorted(jobs)


def test_a_job_that_waits_for_its_turn_or_in_a_worker_is_left_alone(
    store: JobStore, queue: JobQueue, reconciler: Reconciler, redis: Redis, queue_settings: QueueSettings
) -> None:
    jobs = [add(store, age) for age in (60.0, 50.0, 40.0)]
    for job_id in jobs:
        queue.enqueue(store.get(job_id))
        redis.zadd(f"{queue_settings.prefix}queued:normal", {job_id: time.time()})
    fetch(redis, queue_settings)
    redis.zadd(f"{queue_settings.prefix}queued:normal", {jobs[0]: 1.0})
    assert queue.in_flight() == {jobs[0]}
    assert reconciler.republish() == 0


def test_a_hole_in_the_queue_is_found_when_its_turn_has_passed(
    store: JobStore, queue: JobQueue, reconciler: Reconciler, redis: Redis, queue_settings: QueueSettings
) -> None:
    lost, behind = add(store, age=60.0), add(store, age=0.0)
    queue.enqueue(store.get(behind))
    assert reconciler.republish() == 1
    assert waiting(redis, queue_settings) == [behind, lost]


def test_what_does_not_wait_any_more_is_not_published(
    store: JobStore, reconciler: Reconciler, redis: Redis, queue_settings: QueueSettings
) -> None:
    redis.zadd(f"{queue_settings.prefix}queued:normal", {new_job_id(): 1.0})
    cancelled = add(store)
    store.cancel(cancelled)
    started = add(store)
    assert store.start(started) is not None
    assert reconciler.republish() == 0
    assert redis.zcard(f"{queue_settings.prefix}queued:normal") == 0
    assert waiting(redis, queue_settings) == []


def test_a_job_whose_solve_is_lost_waits_again_and_is_given_up_the_second_time(
    store: JobStore, reconciler: Reconciler, redis: Redis, queue_settings: QueueSettings
) -> None:
    job_id = add(store)
    assert store.start(job_id) is not None
    assert reconciler.reclaim() == 0
    assert store.lose(job_id, "", 3_600, TIMED_OUT)
    assert [reconciler.reclaim() for _ in range(2)] == [1, 0]
    record = store.get(job_id)
    assert (record.status, record.losses, record.started_at) == (JobStatus.QUEUED, 1, None)
    assert waiting(redis, queue_settings) == [job_id]

    assert store.start(job_id) is not None
    assert store.lose(job_id, "", 3_600, TIMED_OUT)
    assert reconciler.reclaim() == 0
    error = store.get(job_id).error
    assert error is not None
    assert error.type is FailureType.WORKER_LOST


def test_a_lease_counts_only_while_the_server_is_there(
    redis: Redis, queue: JobQueue, queue_settings: QueueSettings
) -> None:
    """Whoever could not renew because the server was away is given time to do it."""
    settings = queue_settings.model_copy(update={"visibility_seconds": 1e6})
    store = JobStore(redis, settings)
    job_id = add(store)
    assert store.start(job_id) is not None
    redis.zadd(f"{settings.prefix}running", {job_id: 1.0})
    assert store.silent(1.0, 10) == [job_id]
    assert Reconciler(store, queue, silence=1.0).reclaim() == 0
    assert store.get(job_id).status is JobStatus.RUNNING


def test_entries_of_jobs_that_are_not_kept_any_more_are_dropped(
    store: JobStore, redis: Redis, queue_settings: QueueSettings
) -> None:
    kept = add(store)
    redis.zadd(f"{queue_settings.prefix}index", {new_job_id(): 0 for _ in range(5)})
    assert [store.tidy(100), store.tidy(100)] == [5, 0]
    assert [record.id for record in store.page(10)[0]] == [kept]


def test_processes_take_turns(store: JobStore, reconciler: Reconciler, queue: JobQueue) -> None:
    add(store)
    other = Reconciler(store, queue, silence=0.2)
    assert store.take_turn("reconciler", 0.3)
    other.take_turn(0.3)
    assert queue.depth() == 0
    time.sleep(0.4)
    for each in (other, reconciler):
        each.take_turn(60)
    assert queue.depth() == 1


def test_a_hole_is_found_behind_jobs_of_another_priority_that_wait_for_long(
    store: JobStore, queue: JobQueue, reconciler: Reconciler
) -> None:
    patient = add(store, age=60.0, priority=Priority.LOW)
    queue.enqueue(store.get(patient))
    store.published(store.get(patient))
    lost = add(store, age=30.0, priority=Priority.HIGH)
    assert reconciler.republish() == 1
    assert queue.head(Priority.HIGH) is not None
    assert store.queued_before(Priority.HIGH, time.time() - 1, 10) == []
    assert store.get(lost).status is JobStatus.QUEUED


def test_a_waiting_job_whose_deadline_has_passed_ends(store: JobStore, reconciler: Reconciler) -> None:
    now = time.time()
    late, early, running = (
        add(store, 1.0, deadline_at=now - 0.1),
        add(store, 1.0, deadline_at=now + 60),
        add(store, 1.0, deadline_at=now + 0.2),
    )
    assert store.start(running) is not None
    time.sleep(0.3)
    reconciler.give_up_overdue()
    assert [store.get(job_id).status.value for job_id in (late, early, running)] == [
        "failed",
        "queued",
        "running",
    ]
    error = store.get(late).error
    assert error is not None
    assert error.type is FailureType.TIME_LIMIT
    assert store.get(late).attempts == 0
