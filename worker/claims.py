"""Idempotency keys: a client that is not sure whether its job was taken may submit it again."""

from __future__ import annotations

import hashlib
import time
from typing import cast

from redis import Redis

from solvers.errors import OndeletteError
from worker.settings import QueueSettings

KEPT_SECONDS = 86_400
"""How long a key is remembered, in seconds."""

_IN_FLIGHT_SECONDS = 60

# A key is bound to an id before anything is made with it, and for good: whoever comes again after a broken
# connection or a killed process makes, or finds, what has that id.
_TAKE = """
-- KEYS = claim. ARGV = print of the body, new id, now, seconds of a flight, seconds for which it is kept.
local claim = redis.call('HMGET', KEYS[1], 'body', 'id', 'since')
if not claim[1] then
  redis.call('HSET', KEYS[1], 'body', ARGV[1], 'id', ARGV[2], 'since', ARGV[3])
  redis.call('EXPIRE', KEYS[1], ARGV[5])
  return {'free', ARGV[2]}
end
if claim[1] ~= ARGV[1] then return {'reused', ''} end
if claim[3] == '' then return {'settled', claim[2]} end
if ARGV[3] - claim[3] < tonumber(ARGV[4]) then return {'in flight', ''} end
redis.call('HSET', KEYS[1], 'since', ARGV[3])
return {'free', claim[2]}
"""


class KeyInFlight(OndeletteError):
    """The first submission with this key has not been answered yet."""


class KeyReused(OndeletteError):
    """The key was used with another body."""


class Claims:
    """Who used which key for which body, and the id of what was made with it."""

    def __init__(self, redis: Redis, settings: QueueSettings) -> None:
        self._redis = redis
        self._prefix = settings.prefix
        self._take = redis.register_script(_TAKE)

    def take(self, key: str, body: bytes, new_id: str) -> tuple[str, bool]:
        """Claim ``key``; return the id to make something with, and whether that is known to be made.

        It is ``new_id``, or the id of the first submission with the key. Raises KeyInFlight and KeyReused.
        Somebody else may go on with a claim that is neither settled nor released after a minute.
        """
        words = (hashlib.sha256(body).hexdigest(), new_id, time.time(), _IN_FLIGHT_SECONDS, KEPT_SECONDS)
        answer = cast(list[bytes], self._take(keys=[self._name(key)], args=words))
        state, claimed = (word.decode() for word in answer)
        if state == "reused":
            raise KeyReused(key)
        if state == "in flight":
            raise KeyInFlight(key)
        return claimed, state == "settled"

    def settle(self, key: str) -> None:
        """Remember that something was made with the id of ``key``."""
        self._redis.hset(self._name(key), "since", "")

    def release(self, key: str) -> None:
        """Let others go on at once with a claim with which nothing could be made."""
        self._redis.hset(self._name(key), "since", "0")

    def _name(self, key: str) -> str:
        # Hashed: a key is somebody else's text of any length.
        return f"{self._prefix}key:{hashlib.sha256(key.encode()).hexdigest()}"
