"""Ends of jobs that no solve writes: given up, or too late."""

from __future__ import annotations

from worker.records import FailureType, JobError

MAX_LOSSES = 2
"""Workers that a job may lose before it is given up."""

GIVEN_UP = JobError(
    FailureType.WORKER_LOST,
    "The worker was lost.",
    f"The job was started {MAX_LOSSES} times and its worker ended without a word each time; it is not tried "
    "again. A smaller problem may go through; the worker's log tells why it ended.",
)

LATE = JobError(
    FailureType.TIME_LIMIT,
    "The deadline passed.",
    "The time of deadline_seconds was over before the job could be solved.",
)
