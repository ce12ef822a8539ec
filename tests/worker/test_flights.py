"""A job that flies the answer of another one, on a real store."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import replace
from typing import Any

import pytest

from tests.bad_documents import FLEXIBLE_SPACECRAFT
from worker.records import FailureType, JobRecord, JobStatus, new_job_id
from worker.store import JobStore
from worker.tasks import Limits, solve_job

LIMITS = Limits(2**25, grace=30.0, outage=0.0)


def add(store: JobStore, document: Any, source: str | None = None, seconds: float = 60.0) -> str:
    record = JobRecord(new_job_id(), JobStatus.QUEUED, "swcm", seconds, time.time())
    record = replace(record, flights_of=source)
    store.add(record, json.dumps(document).encode())
    return record.id


@pytest.fixture
def source(store: JobStore) -> str:
    job_id = add(store, FLEXIBLE_SPACECRAFT)
    solve_job(job_id, store, LIMITS)
    return job_id


def test_flights_are_flown_and_their_result_is_kept(store: JobStore, source: str) -> None:
    job_id = add(store, {"runs": 3, "parameters": {"k": {"values": [90]}}}, source)
    assert store.get(job_id).flights_of == source
    solve_job(job_id, store, LIMITS)
    assert store.get(job_id).status is JobStatus.SUCCEEDED
    result = json.loads(store.result(job_id) or b"")
    assert (result["job_id"], result["flights_of"], result["runs"]) == (job_id, source, 3)
    assert result["columns"]["k"] == [90.0] * 3
    # What another run of the worker would do to the end: nothing.
    solve_job(job_id, store, LIMITS)
    assert store.get(job_id).attempts == 1


def test_what_was_to_be_flown_may_be_gone_by_then(store: JobStore, source: str) -> None:
    job_id = add(store, {"runs": 3}, source)
    store.erase(source)
    solve_job(job_id, store, LIMITS)
    record = store.get(job_id)
    assert record.status is JobStatus.FAILED
    assert record.error is not None
    assert record.error.type is FailureType.INTERNAL
    assert source in record.error.detail


def test_a_time_limit_and_a_result_that_is_too_large(store: JobStore, source: str) -> None:
    late = add(store, {"runs": 10_000, "coast": 1e6}, source, seconds=0.2)
    solve_job(late, store, LIMITS)
    error = store.get(late).error
    assert error is not None
    assert error.type is FailureType.TIME_LIMIT
    large = add(store, {"runs": 30}, source)
    solve_job(large, store, replace(LIMITS, result_bytes=100))
    error = store.get(large).error
    assert error is not None
    assert "Ask for fewer runs" in error.detail


def test_cancelled_flights_end_at_once_without_a_result(store: JobStore, source: str) -> None:
    job_id = add(store, {"runs": 10_000, "coast": 1e6}, source)
    solving = threading.Thread(target=solve_job, args=(job_id, store, LIMITS))
    solving.start()
    while store.get(job_id).progress is None:
        time.sleep(0.05)
    store.cancel(job_id)
    solving.join(30)
    record = store.get(job_id)
    assert (record.status, record.has_result) == (JobStatus.CANCELLED, False)
