"""Puts right what fell between the record of a job and its message.

The record is the truth, but it is a message that makes a worker look at it. A process that is killed between
recording a sweep and publishing its jobs, a worker that is killed between taking a message and noting that
it did (kombu's BRPOP, celery/kombu#305), or a server that comes back with older data leave a job that nobody
will ever fetch. It is found by its record, and published again. A message too many does no harm: whoever
starts a job that is not waiting is told so.
"""

from __future__ import annotations

import logging
import time

from worker.errors import JobGone, JobNotFound
from worker.queue import JobQueue
from worker.records import JobRecord, JobStatus, Priority
from worker.store import JobStore

logger = logging.getLogger(__name__)

_BATCH = 1_000


class Reconciler:
    """Looks for jobs that nobody works on; any number of processes may, for they take turns.

    A running job is taken back when it has been silent for ``silence`` seconds beyond its lease: by then its
    message should have come again. ``settle`` is the time, in seconds, that a job has to get from its record
    into the queue, and from the queue into a worker; clocks of different machines may differ by as much.
    """

    def __init__(self, store: JobStore, queue: JobQueue, silence: float, settle: float = 5.0) -> None:
        self._store = store
        self._queue = queue
        self._silence = silence
        self._settle = settle

    def take_turn(self, seconds: float) -> None:
        """Look once, unless another process did within the last ``seconds``.

        Raises RedisError, QueueUnavailable and ResultsUnavailable; what was not done then is done at a later
        turn.
        """
        if self._store.take_turn("reconciler", seconds):
            self.reclaim()
            self.republish()
            self._store.tidy(_BATCH)
            # Last: the folder or store that results are in may be away by itself.
            self._store.tidy_results(_BATCH)

    def give_up_overdue(self) -> None:
        """End waiting jobs whose deadline has passed. Cheap: any process may, as often as it likes."""
        self._store.give_up_overdue(_BATCH)

    def reclaim(self) -> int:
        """Take back running jobs whose solve is lost; return how many."""
        silent = self._store.silent(self._silence, _BATCH)
        lost = [job_id for job_id in silent if self._store.reclaim(job_id)]
        for job_id in lost:
            logger.warning("job %s: its worker is silent; it waits for another", job_id)
            self._publish(job_id)
        return len(lost)

    def republish(self) -> int:
        """Publish again the waiting jobs that have no message; return how many.

        Messages of one priority are fetched in the order of their publishing. So a job whose message is lost
        is one that was published before the message that is fetched next, and that no worker holds.
        """
        overdue: list[str] = []
        for priority in Priority:
            head = self._queue.head(priority)
            horizon = (time.time() if head is None else head) - self._settle
            overdue += self._store.queued_before(priority, horizon, _BATCH)
        held = self._queue.in_flight() if overdue else set()
        missing = [job_id for job_id in overdue if job_id not in held]
        return sum(self._publish(job_id) for job_id in missing)

    def _publish(self, job_id: str) -> bool:
        record = self._waiting(job_id)
        if record is None:
            self._store.unlist(job_id)
            return False
        logger.warning("job %s has no message; it is published again", job_id)
        self._queue.enqueue(record)
        self._store.published(record)
        return True

    def _waiting(self, job_id: str) -> JobRecord | None:
        try:
            record = self._store.get(job_id)
        except (JobNotFound, JobGone):
            return None
        return record if record.status is JobStatus.QUEUED else None
