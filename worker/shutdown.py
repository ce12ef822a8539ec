"""How a worker ends: running jobs get a moment to end by themselves, the rest goes back to the queue."""

from __future__ import annotations

import logging
import time
from typing import Any

from celery.apps.worker import Worker
from celery.worker import state
from redis.exceptions import RedisError

from worker.errors import JobGone, JobNotFound
from worker.records import JobStatus
from worker.store import JobStore

logger = logging.getLogger(__name__)

_LOOK_EVERY = 0.1


class PatientWorker(Worker):
    """Celery's worker, which after SIGTERM waits only as long as a job is running, and then no longer."""

    def __init__(self, *args: Any, store: JobStore, patience: float, **kwargs: Any) -> None:
        self._store = store
        self._patience = patience
        super().__init__(*args, **kwargs)

    def wait_for_soft_shutdown(self) -> bool:
        """Wait until no job of this worker runs, ``patience`` seconds at most; tell whether none does.

        Called inside the signal handler, where Celery itself hears nothing of its children; the store does.
        """
        deadline = time.monotonic() + self._patience
        jobs = {request.id for request in tuple(state.active_requests)}
        while (jobs := {job_id for job_id in jobs if self._runs(job_id)}) and time.monotonic() < deadline:
            time.sleep(_LOOK_EVERY)
        if jobs:
            logger.warning("handing back %s", ", ".join(sorted(jobs)))
        return not jobs

    def _runs(self, job_id: str) -> bool:
        try:
            return self._store.get(job_id).status is JobStatus.RUNNING
        except (JobNotFound, JobGone):
            return False
        except RedisError:
            return True
