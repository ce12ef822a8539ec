"""Results outside of the server's memory: what is written there, what becomes of it, and what goes wrong."""

import json
import shutil
import time
from pathlib import Path

import pytest
from pydantic import ValidationError
from redis import Redis

from worker.backup import restore_backup, write_backup
from worker.errors import ResultLost, ResultsUnavailable
from worker.patience import patiently
from worker.records import FailureType, JobError, JobRecord, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore, compress

TEXT = json.dumps({"success": True, "numbers": list(range(1000))}).encode()
ERROR = JobError(FailureType.INFEASIBLE, "Title.", "Detail.")


@pytest.fixture
def results(folder: Path) -> str | None:
    return f"file://{folder}"


def running(store: JobStore) -> tuple[str, str]:
    record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", 60.0, time.time())
    store.add(record, b"{}")
    owner = store.start(record.id, "worker@host/17/0123456789abcdef").owner
    return record.id, owner


def solved(store: JobStore) -> str:
    job_id, owner = running(store)
    assert store.finish(job_id, owner, JobStatus.SUCCEEDED, result=compress(TEXT))
    return job_id


def look_now(store: JobStore) -> int:
    """Let the time of the next look at every result have come; return how many were deleted."""
    register = f"{store.prefix}results"
    for name in store.redis.zrange(register, 0, -1):  # type: ignore[union-attr]
        store.redis.zadd(register, {name: 0})
    return store.tidy_results(100)


def test_the_server_holds_a_reference_and_the_folder_the_bytes(store: JobStore, folder: Path) -> None:
    job_id = solved(store)
    (file,) = folder.iterdir()
    assert file.name.startswith(f"{job_id}.0123456789abcdef.")
    assert file.read_bytes() == compress(TEXT)
    assert store.redis.get(store._keys(job_id)[2]) == f"blob:{file.name}".encode()
    assert store.result(job_id) == TEXT
    assert [store.kept_result(each) for each in (job_id, new_job_id())] == [TEXT, None]
    told = [event.data for event in store.events(job_id) if event.kind == "result"]
    assert told == [{"bytes": len(compress(TEXT))}]


def test_a_solve_that_lost_its_job_leaves_no_result_behind(store: JobStore, folder: Path) -> None:
    job_id, owner = running(store)
    assert store.lose(job_id, "", 3_600, ERROR)
    other = store.start(job_id).owner
    assert not store.finish(job_id, owner, JobStatus.SUCCEEDED, result=compress(b"1"))
    assert list(folder.iterdir()) == []
    assert store.finish(job_id, other, JobStatus.SUCCEEDED, result=compress(TEXT))
    # The same end written again, as if the answer to the first time had been lost on the way.
    assert not store.finish(job_id, other, JobStatus.SUCCEEDED, result=compress(TEXT))
    assert store.result(job_id) == TEXT


def test_a_result_that_was_written_by_a_worker_that_died_then_is_swept_away(
    store: JobStore, folder: Path
) -> None:
    job_id, owner = running(store)
    store.results_kept.put(job_id, owner, compress(TEXT))
    assert look_now(store) == 0, "its job runs: the end may still be written"
    assert len(list(folder.iterdir())) == 1
    assert store.fail(job_id, ERROR)
    assert store.tidy_results(100) == 0, "its time has not come again"
    assert look_now(store) == 1
    assert list(folder.iterdir()) == []
    assert store.redis.zcard(f"{store.prefix}results") == 0


def test_a_result_outlives_neither_its_erased_nor_its_expired_job(
    store: JobStore, redis: Redis, folder: Path
) -> None:
    erased, expired, kept, pinned = (solved(store) for _ in range(4))
    store.pin(pinned, pinned=True)
    store.erase(erased)
    assert len(list(folder.iterdir())) == 3
    assert look_now(store) == 0
    redis.delete(*store._keys(expired)[:3])  # As the server does when their time has passed.
    assert look_now(store) == 1
    assert store.result(kept) == store.result(pinned) == TEXT
    register = f"{store.prefix}results"
    looks = [score - time.time() for _, score in redis.zrange(register, 0, -1, withscores=True)]  # type: ignore[union-attr]
    assert looks == pytest.approx([30 * 86_400] * 2, abs=60)


def test_a_result_that_is_not_there_any_more_is_lost_and_nothing_else(store: JobStore, folder: Path) -> None:
    gone, damaged = solved(store), solved(store)
    for file in folder.iterdir():
        if file.name.startswith(gone):
            file.unlink()
        else:
            file.write_bytes(file.read_bytes()[:-9])
    for job_id in (gone, damaged):
        with pytest.raises(ResultLost):
            store.result(job_id)
        assert store.get(job_id).status is JobStatus.SUCCEEDED
    assert [store.kept_result(each) for each in (gone, damaged)] == [None, None]
    store.erase(gone)


def test_a_folder_that_is_away_is_waited_for(store: JobStore, folder: Path) -> None:
    kept = solved(store)
    away = folder.rename(folder.with_name("unmounted"))
    with pytest.raises(ResultsUnavailable, match="cannot be reached"):
        store.result(kept)
    job_id, owner = running(store)
    asked = 0

    def finish() -> bool:
        nonlocal asked
        asked += 1
        if asked == 2:
            away.rename(folder)
        return store.finish(job_id, owner, JobStatus.SUCCEEDED, result=compress(TEXT))

    assert patiently(finish, 60.0, job_id)
    assert (asked, store.result(job_id), store.result(kept)) == (2, TEXT, TEXT)


@pytest.mark.parametrize("place", [None, "memory://ondelette"])
def test_a_backup_holds_the_results_and_goes_back_to_any_place(
    store: JobStore,
    redis: Redis,
    queue_settings: QueueSettings,
    folder: Path,
    tmp_path: Path,
    place: str | None,
) -> None:
    kept, lost = solved(store), solved(store)
    next(file for file in folder.iterdir() if file.name.startswith(lost)).unlink()
    assert write_backup(store, tmp_path / "backup") == 2
    elsewhere = {"prefix": f"other:{store.prefix}", "results": place}
    other = JobStore(store.redis, queue_settings.model_copy(update=elsewhere))
    shutil.rmtree(folder)
    assert restore_backup(other, tmp_path / "backup") == (2, 0)
    assert other.result(kept) == TEXT
    with pytest.raises(ResultLost):
        other.result(lost)


def test_what_was_in_the_server_before_is_still_read(
    redis: Redis, queue_settings: QueueSettings, store: JobStore
) -> None:
    inside = JobStore(redis, queue_settings.model_copy(update={"results": None}))
    before, outside = solved(inside), solved(store)
    assert store.result(before) == TEXT
    with pytest.raises(ResultsUnavailable, match="ONDELETTE_RESULTS"):
        inside.result(outside)


@pytest.mark.parametrize(
    ("address", "reason"),
    [
        ("/var/results", "must look like"),
        ("file://", "must look like"),
        ("nowhere://x/y", "nowhere"),
        ("s3://bucket/prefix", "s3fs"),
    ],
)
def test_an_address_that_cannot_be_used_is_refused_at_once(address: str, reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        QueueSettings(results=address)
