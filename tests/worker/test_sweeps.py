"""What is remembered of a sweep, and from whom its points start."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest
from redis import Redis
from redis.exceptions import RedisError

from tests.bad_documents import changed
from worker import submitting
from worker.errors import JobNotFound
from worker.neighbours import Neighbours
from worker.records import JobRecord, JobStatus, Priority, SweepPlace, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore
from worker.sweeps import SweepRecord, SweepStore
from worker.tasks import Limits, solve_job

LIMITS = Limits(2**25, grace=30.0, outage=0.0)
VALUES = (98.0, 100.0, 102.0)


@pytest.fixture
def sweeps(store: JobStore, queue_settings: QueueSettings) -> SweepStore:
    return SweepStore(store, queue_settings)


Jobs = list[tuple[JobRecord, bytes]]


def new_sweep() -> tuple[SweepRecord, Jobs]:
    """A sweep of three stiffness values; the last document is one that the worker refuses."""
    record = SweepRecord(new_job_id(), ("/problem/model/parameters/k",), False, 3, time.time(), "a sweep")
    documents: list[Any] = [changed(record.pointers[0], value) for value in VALUES[:2]] + [{"schema": 1}]
    jobs = [
        (
            JobRecord(
                new_job_id(),
                JobStatus.QUEUED,
                "swcm",
                60.0,
                time.time(),
                sweep=SweepPlace(record.id, index, (index / 2,)),
            ),
            json.dumps(document).encode(),
        )
        for index, document in enumerate(documents)
    ]
    return record, jobs


@pytest.fixture(autouse=True)
def parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two jobs at a time, so that three are more than one part."""
    monkeypatch.setattr(submitting, "_AT_ONCE", 2)


@pytest.fixture
def sweep(sweeps: SweepStore) -> SweepRecord:
    record, jobs = new_sweep()
    sweeps.add(record, jobs, [(value,) for value in VALUES])
    return record


def iterations(store: JobStore, job_id: str) -> int:
    return int(json.loads(store.result(job_id) or b"")["statistics"]["iterations"])


def test_a_sweep_is_remembered_with_its_jobs(store: JobStore, sweeps: SweepStore, sweep: SweepRecord) -> None:
    assert sweeps.get(sweep.id) == sweep
    rows = sweeps.table(sweep.id)
    assert [(row.values, row.status, row.ending) for row in rows] == [
        ((value,), "queued", None) for value in VALUES
    ]
    assert store.get(rows[1].job_id).sweep == SweepPlace(sweep.id, 1, (0.5,))
    assert len(store.queued_before(Priority.NORMAL, time.time() + 1, 10)) == 3


def test_points_are_solved_from_their_neighbours_and_noted(
    store: JobStore, sweeps: SweepStore, sweep: SweepRecord
) -> None:
    jobs = [row.job_id for row in sweeps.table(sweep.id)]
    for job_id in jobs:
        solve_job(job_id, store, LIMITS, neighbours=Neighbours(store, sweeps))
    rows = sweeps.table(sweep.id)
    assert [row.status for row in rows] == ["succeeded", "succeeded", "failed"]
    assert rows[2].ending == {"status": "failed", "error": "internal"}
    ending = rows[1].ending
    assert ending is not None
    stored = json.loads(store.result(jobs[1]) or b"")
    assert ending["objective"] == stored["objective"] == pytest.approx(25.866, abs=2e-3)
    assert ending["verification"]["passed"] is True
    # Each process of the three knew nothing: the second point was started from what the first had stored.
    assert iterations(store, jobs[1]) < iterations(store, jobs[0])
    finished = sweeps.get(sweep.id).finished_at
    assert finished is not None
    assert finished <= time.time()


def test_an_ending_that_nobody_noted_is_found(
    store: JobStore, sweeps: SweepStore, sweep: SweepRecord, redis: Redis
) -> None:
    first, second, third = (row.job_id for row in sweeps.table(sweep.id))
    solve_job(first, store, LIMITS)  # without a sweep to note it
    store.cancel(second)
    owner = store.start(third).owner
    rows = sweeps.table(sweep.id)
    assert [row.status for row in rows] == ["succeeded", "cancelled", "running"]
    assert rows[0].ending is not None
    assert rows[0].ending["success"] is True
    assert sweeps.get(sweep.id).finished_at is None
    assert owner is not None
    store.finish(third, owner, JobStatus.FAILED)
    store.erase(third)
    assert [row.status for row in sweeps.table(sweep.id)] == ["succeeded", "cancelled", "gone"]
    assert sweeps.get(sweep.id).finished_at is not None
    # Noted once and for all: the table lives as long as the jobs were to.
    assert redis.ttl(f"{store.prefix}sweep:{sweep.id}:ends") > 0


def test_what_is_noted_first_stays(sweeps: SweepStore, sweep: SweepRecord) -> None:
    at = SweepPlace(sweep.id, 0, (0.0,))
    sweeps.note(at, {"status": "succeeded", "error": None})
    sweeps.note(at, {"status": "failed", "error": "internal"})
    assert sweeps.table(sweep.id)[0].status == "succeeded"


def test_of_a_sweep_that_cannot_be_remembered_nothing_is_left_to_solve(
    store: JobStore, sweeps: SweepStore
) -> None:
    record, jobs = new_sweep()
    # What no script can make a record of.
    store.redis.set(store._keys(jobs[2][0].id)[0], "in the way")
    with pytest.raises(RedisError):
        sweeps.add(record, jobs, [(value,) for value in VALUES])
    assert not sweeps.exists(record.id)
    assert [store.get(job.id).status for job, _ in jobs[:2]] == [JobStatus.CANCELLED] * 2


def test_all_jobs_are_cancelled(store: JobStore, sweeps: SweepStore, sweep: SweepRecord) -> None:
    first, *_ = sweeps.table(sweep.id)
    store.start(first.job_id)
    sweeps.cancel(sweep.id)
    assert [row.status for row in sweeps.table(sweep.id)] == ["running", "cancelled", "cancelled"]
    assert store.get(first.job_id).cancel_requested


@pytest.mark.parametrize("unknown", ["", "x", "01a22022-d193-7d62-9f31-f11c2ab70755"])
def test_an_unknown_sweep(sweeps: SweepStore, unknown: str) -> None:
    for ask in (sweeps.get, sweeps.table, sweeps.cancel):
        with pytest.raises(JobNotFound):
            ask(unknown)


def test_the_nearest_answer_is_taken(store: JobStore, sweeps: SweepStore, sweep: SweepRecord) -> None:
    neighbours = Neighbours(store, sweeps)
    jobs = [row.job_id for row in sweeps.table(sweep.id)]
    assert neighbours.nearest(SweepPlace(sweep.id, 1, (0.5,))) is None
    for job_id in jobs[:2]:
        solve_job(job_id, store, LIMITS, neighbours=neighbours)
    objective = [json.loads(store.result(job_id) or b"")["final_time"] for job_id in jobs[:2]]
    for place, expected in ((0.1, objective[0]), (0.9, objective[1])):
        for process in (neighbours, Neighbours(store, sweeps)):
            answer = process.nearest(SweepPlace(sweep.id, 2, (place,)))
            assert answer is not None
            assert answer.tf == pytest.approx(expected, rel=1e-12)


def test_a_point_whose_neighbour_was_erased_starts_from_another(
    store: JobStore, sweeps: SweepStore, sweep: SweepRecord
) -> None:
    jobs = [row.job_id for row in sweeps.table(sweep.id)]
    for job_id in jobs[:2]:
        solve_job(job_id, store, LIMITS, neighbours=Neighbours(store, sweeps))
    store.erase(jobs[1])
    answer = Neighbours(store, sweeps).nearest(SweepPlace(sweep.id, 2, (1.0,)))
    assert answer is not None
    assert answer.tf == pytest.approx(json.loads(store.result(jobs[0]) or b"")["final_time"])
