"""Who owns a job, for how long, and what the broker is told of it."""

import signal
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import cast

import pytest
from redis import Redis

from solvers.progress import ProgressReport
from worker.outcome import TIMED_OUT
from worker.records import FailureType, JobRecord, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore, Signal, new_owner, solver_of

LEASE = 0.8


@pytest.fixture
def brief(redis: Redis, queue_settings: QueueSettings) -> JobStore:
    """A store whose leases are short."""
    settings = queue_settings.model_copy(update={"visibility_seconds": 2 * LEASE, "renewal_seconds": LEASE})
    assert settings.lease_seconds == LEASE
    # Leases are not over before the server itself has been there for as long.
    while cast(dict[str, int], redis.info("server"))["uptime_in_seconds"] < 1:
        time.sleep(0.05)
    return JobStore(redis, settings)


@pytest.fixture
def job_id(brief: JobStore) -> str:
    record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time())
    brief.add(record, b"{}")
    return record.id


def test_a_message_that_comes_again_leaves_a_running_job_alone(brief: JobStore, job_id: str) -> None:
    owner = brief.start(job_id).owner
    before = brief.get(job_id)
    for _ in range(3):
        assert brief.start(job_id) is None
    assert brief.get(job_id) == before
    assert brief.report(job_id, owner, None) is Signal.GO


def test_a_start_whose_answer_was_lost_is_confirmed(brief: JobStore, job_id: str) -> None:
    word = new_owner("worker/1/")
    first, again = (brief.start(job_id, word) for _ in range(2))
    assert first == again
    assert first.owner == word
    assert brief.get(job_id).attempts == 1


def test_a_silent_solve_loses_its_job_when_its_lease_is_over(brief: JobStore, job_id: str) -> None:
    silent = brief.start(job_id).owner
    time.sleep(LEASE + 0.1)
    assert brief.start(job_id) is not None
    assert (brief.get(job_id).attempts, brief.get(job_id).losses) == (2, 1)
    assert brief.report(job_id, silent, ProgressReport("solve", 1)) is Signal.LOST


def test_reports_keep_a_job(brief: JobStore, job_id: str) -> None:
    owner = brief.start(job_id).owner
    give_up = time.monotonic() + 2 * LEASE
    while time.monotonic() < give_up:
        assert brief.report(job_id, owner, None) is Signal.GO
        time.sleep(0.1)
    assert brief.start(job_id) is None


def test_the_main_process_keeps_jobs_and_messages(
    brief: JobStore, job_id: str, redis: Redis, queue_settings: QueueSettings
) -> None:
    """A child that holds the interpreter for long does not report; its main process speaks for it."""
    index = f"{queue_settings.prefix}unacked_index"
    assert brief.start(job_id, new_owner(solver_of("worker", 7))) is not None
    redis.zadd(index, {"tag": 1.0})
    give_up = time.monotonic() + 2 * LEASE
    while time.monotonic() < give_up:
        brief.renew([(job_id, "tag", solver_of("worker", 7)), (new_job_id(), "none", solver_of("worker"))])
        time.sleep(0.2)
    assert brief.start(job_id) is None
    # Only what the broker has delivered is renewed; nothing is added.
    assert redis.zrange(index, 0, -1) == [b"tag"]
    assert redis.zscore(index, "tag") == pytest.approx(time.time(), abs=1)


@pytest.mark.parametrize("other", [solver_of("worker", 77), solver_of("work"), solver_of("else", 7)])
def test_nobody_speaks_for_the_child_of_another(brief: JobStore, job_id: str, other: str) -> None:
    assert brief.start(job_id, new_owner(solver_of("worker", 7))) is not None
    assert not brief.fail(job_id, TIMED_OUT, other)
    assert not brief.lose(job_id, other, 30, TIMED_OUT)
    assert not brief.hand_back(job_id, other)
    assert brief.get(job_id).status is JobStatus.RUNNING
    time.sleep(LEASE + 0.1)
    brief.renew([(job_id, "tag", other)])
    assert brief.start(job_id) is not None


def test_a_child_that_died_loses_its_job_at_once(brief: JobStore, job_id: str) -> None:
    assert brief.start(job_id, new_owner(solver_of("worker", 7))) is not None
    assert brief.lose(job_id, solver_of("worker", 7), 30, TIMED_OUT)
    assert brief.start(job_id) is not None
    assert brief.get(job_id).losses == 1


def test_a_child_that_died_because_its_time_was_over_ends_its_job(brief: JobStore) -> None:
    record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 0.1, time.time())
    brief.add(record, b"{}")
    assert brief.start(record.id) is not None
    time.sleep(0.35)
    assert brief.lose(record.id, "", 0.2, TIMED_OUT)
    ended = brief.get(record.id)
    assert (ended.status, ended.error) == (JobStatus.FAILED, TIMED_OUT)
    assert ended.error is not None
    assert ended.error.type is FailureType.TIME_LIMIT


def test_the_step_renews_what_the_worker_holds(
    brief: JobStore, job_id: str, redis: Redis, queue_settings: QueueSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    from celery.worker import state
    from kombu.asynchronous.timer import Timer

    from worker.leases import leases

    request = SimpleNamespace(
        id=job_id, message=SimpleNamespace(delivery_tag="tag"), hostname="worker", worker_pid="7"
    )
    monkeypatch.setattr(state, "reserved_requests", {id(request): request}.values())
    index = f"{queue_settings.prefix}unacked_index"
    redis.zadd(index, {"tag": 1.0})
    consumer = SimpleNamespace(timer=Timer())
    step = leases(brief, 60.0)(consumer)
    step.start(consumer)
    assert redis.zscore(index, "tag") == pytest.approx(time.time(), abs=1)
    (entry,) = consumer.timer.queue
    step.stop(consumer)
    assert entry.entry.canceled


SOLVE_THAT_NEVER_RETURNS = """
import sys, time
from worker.patience import process_limit

with process_limit(0.3):
    pass
time.sleep(0.5)
print("within its limit", flush=True)
with process_limit(0.3):
    sum(range(10**12))
"""


def test_a_solve_that_never_returns_is_ended_and_says_where_it_was() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", SOLVE_THAT_NEVER_RETURNS],
        capture_output=True,
        text=True,
        timeout=20,
        check=False,
    )
    assert (ended.returncode, ended.stdout) == (-signal.SIGALRM, "within its limit\n")
    assert "most recent call first" in ended.stderr
    assert "line 10" in ended.stderr
