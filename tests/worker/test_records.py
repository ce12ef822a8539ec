import re
from itertools import pairwise

from worker.records import TRANSITIONS, FailureType, JobError, JobRecord, JobStatus, new_job_id, timestamp


def test_the_final_statuses_are_those_that_nothing_follows() -> None:
    assert {status for status in JobStatus if status.final} == {"succeeded", "failed", "cancelled"}
    assert set(TRANSITIONS) == set(JobStatus)


def test_ids_are_uuids_of_version_7_that_sort_by_time() -> None:
    now = 1_800_000_000.0
    ids = [new_job_id(now + microsecond * 1e-6) for microsecond in range(0, 5_000, 10)]
    assert ids == sorted(ids)
    assert len(set(ids)) == len(ids)
    assert all(
        re.fullmatch(r"[0-9a-f]{8}-[0-9a-f]{4}-7[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}", id) for id in ids
    )


def test_ids_of_one_moment_differ_in_their_random_part() -> None:
    ids = {new_job_id(1.0) for _ in range(1_000)}
    assert len(ids) == 1_000
    assert all(first[:18] == second[:18] for first, second in pairwise(ids))


def test_a_record_survives_its_hash() -> None:
    record = JobRecord(
        id=new_job_id(),
        status=JobStatus.QUEUED,
        method="swcm",
        max_seconds=12.5,
        created_at=1_800_000_000.123456,
        name="naïve \u2028 name",
        tags=("a", "b,c"),
    )
    assert JobRecord.from_hash(record.to_hash()) == record


def test_an_error_survives_its_json() -> None:
    error = JobError(FailureType.INFEASIBLE, "Title.", 'A "detail".')
    assert JobError.from_json(error.to_json()) == error


def test_times_are_rfc_3339_in_utc() -> None:
    assert timestamp(0.25) == "1970-01-01T00:00:00.250Z"
