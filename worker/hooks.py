"""Messages that are to be sent when jobs have ended: who is told, when it is tried next, how often it was.

A job with a webhook is on the list from its submission on. Whoever looks at it takes it for a while, so that
of all processes one sends the message; a process that is lost in between leaves it to another. So a message
may come twice, with the same id, but is not lost.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, cast

from redis import Redis

from worker.settings import QueueSettings

_TAKE = """
-- KEYS = list. ARGV = now, until when what is taken belongs to us, most that is taken.
local due = redis.call('ZRANGEBYSCORE', KEYS[1], '-inf', ARGV[1], 'LIMIT', 0, ARGV[3])
for _, id in ipairs(due) do redis.call('ZADD', KEYS[1], ARGV[2], id) end
return due
"""

# Enough to send as many as are taken, even if nobody answers.
_HELD = 180.0
_MOST = 32


class HookList:
    """The list of jobs whose end is to be told. Safe to share between threads and processes."""

    def __init__(self, redis: Redis, settings: QueueSettings) -> None:
        self._redis = redis
        self.due = f"{settings.prefix}hooks"
        """The list itself: a sorted set of job ids by the time at which they are looked at next."""
        self._tries = f"{settings.prefix}hooks:tries"
        self._take = cast(Callable[..., Any], redis.register_script(_TAKE))

    def take(self) -> list[str]:
        """Return jobs that are to be looked at now; they are ours for three minutes."""
        now = time.time()
        taken = self._take(keys=[self.due], args=[now, now + _HELD, _MOST])
        return [job_id.decode() for job_id in taken]

    def again(self, job_id: str, seconds: float) -> None:
        """Let a job be looked at again in so many seconds."""
        self._redis.zadd(self.due, {job_id: time.time() + seconds}, xx=True)

    def tried(self, job_id: str) -> int:
        """Count a message that did not arrive; returns how many did not so far."""
        return int(self._redis.hincrby(self._tries, job_id, 1))

    def done(self, job_id: str) -> None:
        """Take a job off the list."""
        with self._redis.pipeline(transaction=True) as pipe:
            pipe.zrem(self.due, job_id)
            pipe.hdel(self._tries, job_id)
            pipe.execute()
