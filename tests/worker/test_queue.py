import base64
import json
import math
import time
from pathlib import Path

import pytest
from pydantic import ValidationError
from redis import Redis

from worker.celery_app import make_celery
from worker.errors import QueueUnavailable
from worker.messages import PUBLISHED, SOLVE_TASK
from worker.queue import JobQueue
from worker.records import JobRecord, JobStatus, Priority, new_job_id
from worker.settings import QueueSettings
from worker.store import connect


@pytest.fixture
def queue(redis: Redis, queue_settings: QueueSettings) -> JobQueue:
    return JobQueue(redis, queue_settings)


def record(priority: Priority = Priority.NORMAL) -> JobRecord:
    return JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time(), priority=priority)


def test_a_job_waits_in_the_queue_under_the_prefix(queue: JobQueue, redis: Redis) -> None:
    assert queue.depth() == 0
    for priority in (Priority.LOW, Priority.HIGH):
        queue.enqueue(record(priority))
    assert queue.depth() == 2
    assert [queue.head(priority) is not None for priority in Priority] == [True, False, True]


def test_a_message_is_written_as_celery_writes_it(
    queue: JobQueue, redis: Redis, queue_settings: QueueSettings
) -> None:
    job = record()
    queue.enqueue(job)
    conf = make_celery(queue_settings)
    with conf.connection_for_write() as connection:
        conf.send_task(
            SOLVE_TASK,
            args=[job.id],
            task_id=job.id,
            queue="solve.normal",
            headers={PUBLISHED: 0.0},
            time_limit=math.ceil(60 + queue_settings.grace_seconds + queue_settings.outage_seconds),
            connection=connection,
        )
    theirs, ours = map(json.loads, redis.lrange(f"{queue_settings.prefix}solve.normal", 0, -1))
    # Names that differ with every sender and message.
    for message in (ours, theirs):
        assert message["properties"].pop("delivery_tag")
        message["properties"].pop("reply_to", None)
        message["headers"].pop("origin", None)
        message["headers"].pop(PUBLISHED)
        message["body"] = json.loads(base64.b64decode(message["body"]))
    assert ours == theirs


def test_a_broker_that_is_away_is_said_at_once(tmp_path: Path) -> None:
    settings = QueueSettings(broker=f"unix://{tmp_path}/nobody.sock")
    queue = JobQueue(connect(settings), settings)
    began = time.monotonic()
    with pytest.raises(QueueUnavailable):
        queue.enqueue(record())
    assert time.monotonic() - began < 5


def test_a_worker_is_alive_until_it_leaves_or_falls_silent(queue: JobQueue) -> None:
    assert queue.workers() == {}
    queue.beat("one@host", 2, 60)
    queue.beat("two@host", 4, 0.2)
    assert queue.workers() == {"one@host": 2, "two@host": 4}
    time.sleep(0.3)
    assert queue.workers() == {"one@host": 2}
    queue.leave("one@host")
    assert queue.workers() == {}


def test_only_json_is_accepted_and_nothing_is_lost_with_a_worker(queue_settings: QueueSettings) -> None:
    conf = make_celery(queue_settings).conf
    assert conf.accept_content == ["json"]
    assert conf.task_acks_late
    assert conf.task_reject_on_worker_lost
    assert conf.worker_prefetch_multiplier == 1
    assert conf.task_soft_time_limit is None


def test_a_lease_is_renewed_before_it_is_over_and_over_before_the_message_comes_again() -> None:
    settings = QueueSettings()
    assert settings.renewal_seconds < settings.lease_seconds < settings.visibility_seconds
    assert make_celery(settings).conf.broker_transport_options["visibility_timeout"] == 30
    with pytest.raises(ValidationError, match="at least three times renewal_seconds"):
        QueueSettings(visibility_seconds=10, renewal_seconds=5)
