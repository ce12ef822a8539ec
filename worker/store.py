"""The memory of the service: job records, documents, progress and results in Redis."""

from __future__ import annotations

from worker.caring import Caring
from worker.connection import connect
from worker.solving import Assignment, Signal, Solving, new_owner, solver_of
from worker.submitting import Submitting, compress

__all__ = ["Assignment", "JobStore", "Signal", "compress", "connect", "new_owner", "solver_of"]


class JobStore(Submitting, Solving, Caring):
    """Everything that is remembered of jobs. Safe to share between threads and to use after a fork.

    Methods that name a job raise JobNotFound for an id that nobody knows and JobGone for one that was erased
    or has outlived its retention; all raise redis.exceptions.RedisError where the server does not answer, and
    those about results ResultsUnavailable where the place outside of it does not (`worker.results`).
    """
