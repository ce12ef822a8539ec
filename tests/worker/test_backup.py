"""What is written to a file comes back as it was, into any server."""

import gzip
import json
import time
from pathlib import Path

import pytest
from redis import Redis

from worker.backup import BackupError, restore_backup, write_backup
from worker.claims import Claims
from worker.queue import JobQueue
from worker.reconciler import Reconciler
from worker.records import DEFAULT_PROJECT, FailureType, JobError, JobRecord, JobStatus, Priority, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore, compress

ERROR = JobError(FailureType.INFEASIBLE, "Title.", "Detail.")


@pytest.fixture
def other(redis: Redis, queue_settings: QueueSettings) -> JobStore:
    """Another service, on the same server under another prefix."""
    return JobStore(redis, queue_settings.model_copy(update={"prefix": f"other:{queue_settings.prefix}"}))


def add(store: JobStore, status: JobStatus) -> str:
    record = JobRecord(
        new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time() - 60.0, priority=Priority.HIGH
    )
    store.add(record, b'{"schema": 1}')
    if status is not JobStatus.QUEUED:
        owner = store.start(record.id).owner
        if status.final:
            failure = ERROR if status is JobStatus.FAILED else None
            assert store.finish(record.id, owner, status, failure, compress(b'{"x": "\xc3\xa9"}'), "digest")
    return record.id


def restore(other: JobStore, path: Path) -> tuple[int, int]:
    return restore_backup(other, path)


def test_jobs_come_back_as_they_were(
    store: JobStore, other: JobStore, redis: Redis, queue_settings: QueueSettings, tmp_path: Path
) -> None:
    ended = [add(store, status) for status in (JobStatus.SUCCEEDED, JobStatus.FAILED)]
    store.pin(ended[0], pinned=True)
    erased = add(store, JobStatus.SUCCEEDED)
    store.erase(erased)
    Claims(redis, queue_settings).take("key", b"body", ended[0])
    assert write_backup(store, tmp_path / "backup") == 2
    assert restore(other, tmp_path / "backup") == (2, 0)
    for job_id in ended:
        assert other.get(job_id) == store.get(job_id)
        assert other.document(job_id) == store.document(job_id)
        assert other.result(job_id) == store.result(job_id)
        assert other.events(job_id) == store.events(job_id)
        there, here = (redis.ttl(each._keys(job_id)[0]) for each in (other, store))
        assert there == pytest.approx(here, abs=2)
    assert [record.id for record in other.page(10)[0]] == ended[::-1]
    assert other.answered(DEFAULT_PROJECT, "digest") == erased
    assert not other.exists(erased)
    assert redis.exists(f"{other.prefix}gone:{erased}")
    assert any(key.startswith(f"{other.prefix}key:".encode()) for key in redis.scan_iter("*key:*"))
    assert restore(other, tmp_path / "backup") == (0, 2)


def test_what_waited_or_ran_is_published_again(
    store: JobStore, other: JobStore, redis: Redis, queue_settings: QueueSettings, tmp_path: Path
) -> None:
    jobs = [add(store, JobStatus.QUEUED), add(store, JobStatus.RUNNING)]
    write_backup(store, tmp_path / "backup")
    assert restore(other, tmp_path / "backup") == (2, 0)
    assert [other.get(job_id).status.value for job_id in jobs] == ["queued", "queued"]
    settings = queue_settings.model_copy(update={"prefix": other.prefix})
    queue = JobQueue(redis, settings)
    assert Reconciler(other, queue, silence=30.0).republish() == 2
    owner = other.start(jobs[1]).owner
    assert other.finish(jobs[1], owner, JobStatus.SUCCEEDED)
    assert (other.get(jobs[1]).attempts, other.get(jobs[1]).losses) == (2, 0)


def test_what_is_there_stays_as_it_is(
    store: JobStore, redis: Redis, queue_settings: QueueSettings, tmp_path: Path
) -> None:
    job_id = add(store, JobStatus.QUEUED)
    write_backup(store, tmp_path / "backup")
    store.cancel(job_id)
    before = store.get(job_id)
    assert restore(store, tmp_path / "backup") == (0, 1)
    assert store.get(job_id) == before


@pytest.mark.parametrize("harm", ["cut", "shortened", "foreign", "empty"])
def test_a_file_that_is_no_whole_backup_is_refused_before_anything_is_written(
    store: JobStore, other: JobStore, redis: Redis, queue_settings: QueueSettings, tmp_path: Path, harm: str
) -> None:
    path = tmp_path / "backup"
    add(store, JobStatus.SUCCEEDED)
    write_backup(store, path)
    if harm == "cut":
        path.write_bytes(path.read_bytes()[:-20])
    elif harm == "shortened":
        lines = gzip.decompress(path.read_bytes()).splitlines(keepends=True)
        path.write_bytes(gzip.compress(b"".join(lines[:-2])))
    elif harm == "foreign":
        path.write_bytes(gzip.compress(json.dumps({"format": 1}).encode()))
    else:
        path.write_bytes(b"")
    with pytest.raises(BackupError, match="backup"):
        restore(other, path)
    assert other.page(10) == ([], None)
