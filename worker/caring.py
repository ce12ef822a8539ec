"""The side of the store that looks after what nobody works on."""

from __future__ import annotations

import time
from typing import cast

from worker.keyspace import Keyspace
from worker.records import JobRecord, JobStatus, Priority
from worker.verdicts import GIVEN_UP, LATE, MAX_LOSSES


class Caring(Keyspace):
    """Jobs whose message, worker or time is gone; entries that are no longer needed."""

    def queued_before(self, priority: Priority, moment: float, limit: int) -> list[str]:
        """List jobs of a priority that were published before ``moment`` and wait since, longest first."""
        return self._listed(self._queued[priority], moment, limit)

    def silent(self, seconds: float, limit: int) -> list[str]:
        """List running jobs whose lease has been over for ``seconds``."""
        now, _ = self.redis.time()
        return self._listed(self._running, now - seconds, limit)

    def published(self, record: JobRecord) -> None:
        """Note that a waiting job was published again just now."""
        with self.redis.pipeline(transaction=True) as pipe:
            pipe.zadd(self._queued[record.priority], {record.id: time.time()}, xx=True)
            pipe.hincrby(self._counts, "republished", 1)
            pipe.execute()

    def unlist(self, job_id: str) -> None:
        """Take a job that does not wait off the lists of those that do."""
        with self.redis.pipeline(transaction=True) as pipe:
            for register in self._queued.values():
                pipe.zrem(register, job_id)
            pipe.execute()

    def give_up_overdue(self, limit: int) -> int:
        """End waiting jobs whose deadline has passed; return how many."""
        late = self._listed(self._deadlines, time.time(), limit)
        return sum(bool(self._run(self._give_up, job_id, LATE.to_json())) for job_id in late)

    def reclaim(self, job_id: str) -> bool:
        """Take a job from a solve that is lost; True if it waits again and is to be published."""
        return bool(self._run(self._reclaim, job_id, MAX_LOSSES, GIVEN_UP.to_json()))

    def relist(self, job_id: str) -> None:
        """List a job that was put back from a backup; one that waited or ran waits again."""
        record = self.get(job_id)
        with self.redis.pipeline(transaction=True) as pipe:
            pipe.zadd(self._index, {job_id: 0})
            pipe.zadd(self._index_of(record.project), {job_id: 0})
            pipe.sadd(self._projects, record.project)
            if not record.status.final:
                job = self._keys(job_id)[0]
                pipe.hset(job, "status", JobStatus.QUEUED.value)
                pipe.hdel(job, "owner", "started_at", "progress")
                pipe.hincrby(job, "version", 1)
                pipe.sadd(self._active_of(record.project), job_id)
                pipe.zadd(self._queued[record.priority], {job_id: record.created_at})
                if record.deadline_at is not None:
                    pipe.zadd(self._deadlines, {job_id: record.deadline_at})
            pipe.execute()

    def tidy_results(self, limit: int) -> int:
        """Look at up to ``limit`` results outside of the server and delete those that nobody needs.

        Returns how many these were. Raises ResultsUnavailable.
        """
        return self.results_kept.tidy(limit, self._result_of)

    def _result_of(self, job_id: str) -> tuple[bool, bytes | None, float]:
        job, _, result, _ = self._keys(job_id)
        with self.redis.pipeline(transaction=True) as pipe:
            pipe.hget(job, "status")
            pipe.get(result)
            pipe.ttl(result)
            status, stored, left = pipe.execute()
        return status is not None and not JobStatus(status.decode()).final, stored, left

    def tidy(self, limit: int) -> int:
        """Drop those of the ``limit`` oldest entries of the list of jobs whose time of keeping has passed."""
        projects = cast(set[bytes], self.redis.smembers(self._projects))
        dropped = 0
        for index in (self._index, *(self._index_of(name.decode()) for name in projects)):
            ids = cast(list[bytes], self.redis.zrangebylex(index, "-", "+", start=0, num=limit))
            with self.redis.pipeline(transaction=False) as pipe:
                for job_id in ids:
                    pipe.exists(self._keys(job_id.decode())[0])
                there = pipe.execute() if ids else []
            gone = [job_id for job_id, known in zip(ids, there, strict=True) if not known]
            dropped += self.redis.zrem(index, *gone) if gone else 0
        return dropped
