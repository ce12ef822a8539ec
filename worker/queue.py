"""The queue: how a job is published, how long the line is and who serves it."""

from __future__ import annotations

import json
import math
from typing import cast

from redis import Redis
from redis.exceptions import RedisError

from worker.errors import QueueUnavailable
from worker.messages import PUBLISHED, message_of
from worker.priorities import queue_of
from worker.records import JobRecord, Priority
from worker.settings import QueueSettings


class JobQueue:
    """Where jobs wait. Safe to share between threads."""

    def __init__(self, redis: Redis, settings: QueueSettings) -> None:
        self._redis = redis
        self._prefix = settings.prefix
        # A child ends itself at max_seconds + grace; this is for one that cannot even do that.
        self._beyond = settings.grace_seconds + settings.outage_seconds

    def publication(self, record: JobRecord) -> tuple[str, bytes]:
        """Return the list in which a job waits to be fetched, and the message that is pushed to its left."""
        limit = math.ceil(record.max_seconds + self._beyond)
        return self._key(record.priority), message_of(record.id, queue_of(record.priority), limit)

    def enqueue(self, *records: JobRecord) -> None:
        """Publish jobs that were recorded before, in their order.

        Raises QueueUnavailable if the broker did not take them, or not all.
        """
        try:
            with self._redis.pipeline(transaction=False) as pipe:
                for record in records:
                    pipe.lpush(*self.publication(record))
                pipe.execute()
        except RedisError as error:
            raise QueueUnavailable("the broker did not take the job") from error

    def head(self, priority: Priority) -> float | None:
        """Return when the message of a priority that is fetched next was published, None if there is none."""
        message = cast(bytes | None, self._redis.lindex(self._key(priority), -1))
        return None if message is None else float(json.loads(message)["headers"][PUBLISHED])

    def in_flight(self) -> set[str]:
        """Return the ids of the jobs whose messages workers hold, or held before they were lost."""
        held = cast(list[bytes], self._redis.hvals(f"{self._prefix}unacked"))
        return {str(json.loads(text)[0]["headers"]["id"]) for text in held}

    def depth(self) -> int:
        """Return how many jobs wait that no worker has fetched."""
        with self._redis.pipeline(transaction=True) as pipe:
            for priority in Priority:
                pipe.llen(self._key(priority))
            return sum(pipe.execute())

    def _key(self, priority: Priority) -> str:
        return f"{self._prefix}{queue_of(priority)}"

    # A worker is alive as long as it says so: a key for each, which the server lets expire.

    def beat(self, worker: str, slots: int, seconds: float) -> None:
        """Note that ``worker``, which solves ``slots`` jobs at a time, is alive for the next ``seconds``."""
        with self._redis.pipeline(transaction=True) as pipe:
            pipe.sadd(f"{self._prefix}workers", worker)
            pipe.set(f"{self._prefix}worker:{worker}", slots, px=round(1000 * seconds))
            pipe.execute()

    def leave(self, worker: str) -> None:
        """Note that ``worker`` takes no more jobs."""
        with self._redis.pipeline(transaction=True) as pipe:
            pipe.srem(f"{self._prefix}workers", worker)
            pipe.delete(f"{self._prefix}worker:{worker}")
            pipe.execute()

    def workers(self) -> dict[str, int]:
        """Return the workers that are alive, each with the number of jobs that it solves at a time."""
        names = sorted(cast(set[bytes], self._redis.smembers(f"{self._prefix}workers")))
        if not names:
            return {}
        slots = cast(
            list[bytes | None], self._redis.mget([f"{self._prefix}worker:{name.decode()}" for name in names])
        )
        silent = [name for name, number in zip(names, slots, strict=True) if number is None]
        if silent:
            self._redis.srem(f"{self._prefix}workers", *silent)
        return {
            name.decode(): int(number)
            for name, number in zip(names, slots, strict=True)
            if number is not None
        }
