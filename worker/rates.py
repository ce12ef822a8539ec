"""How often somebody may ask: a token bucket for each, kept in the server, so that all processes share it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

from redis import Redis

from worker.settings import QueueSettings

_TAKE = """
-- KEYS = bucket. ARGV = tokens that it holds, seconds in which it fills. Answers whether there was a token,
-- how many are left, seconds until there is one (x 1000), seconds until it is full.
-- A server without room refuses the first write of a script only if that takes some; a full one is read, too.
redis.call('HDEL', KEYS[1], '')
local time = redis.call('TIME')
local now = tonumber(time[1]) + tonumber(time[2]) / 1e6
local size, period = tonumber(ARGV[1]), tonumber(ARGV[2])
local bucket = redis.call('HMGET', KEYS[1], 'tokens', 'at')
local since = now - (tonumber(bucket[2]) or now)
local tokens = math.min(size, (tonumber(bucket[1]) or size) + since * size / period)
local granted = tokens >= 1
if granted then tokens = tokens - 1 end
redis.call('HSET', KEYS[1], 'tokens', string.format('%.6f', tokens), 'at', string.format('%.6f', now))
redis.call('EXPIRE', KEYS[1], math.ceil(period) + 1)
local wait = math.max(0, (1 - tokens) * period / size)
local full = math.ceil((size - tokens) * period / size)
return {granted and 1 or 0, math.floor(tokens), math.ceil(1000 * wait), full}
"""

PERIOD = 60
"""Seconds in which a bucket fills."""


@dataclass(frozen=True, slots=True)
class Grant:
    """The answer to a question for a token: ``remaining`` tokens, the bucket is full in ``reset`` s.

    ``wait`` is the time until there is a token, in seconds; of use where none was granted.
    """

    granted: bool
    limit: int
    remaining: int
    wait: float
    reset: int


class RateLimiter:
    """Buckets by name. Safe to share; raises RedisError where the server does not answer."""

    def __init__(self, redis: Redis, settings: QueueSettings) -> None:
        self._prefix = settings.prefix
        self._take = cast(Callable[..., Any], redis.register_script(_TAKE))

    def take(self, name: str, limit: int) -> Grant:
        """Take a token from the bucket ``name``, which holds ``limit`` of them."""
        granted, remaining, wait, reset = self._take(
            keys=[f"{self._prefix}rate:{name}"], args=[limit, PERIOD]
        )
        return Grant(bool(granted), limit, remaining, wait / 1000, reset)
