"""Idempotency keys: a client that is not sure whether its job was taken may submit it again."""

from __future__ import annotations

import hashlib
import json
from typing import cast

from redis import Redis

from solvers.errors import OndeletteError
from worker.settings import QueueSettings

KEPT_SECONDS = 86_400
"""How long a key is remembered, in seconds."""

_IN_FLIGHT_SECONDS = 60


class KeyInFlight(OndeletteError):
    """The first submission with this key has not been answered yet."""


class KeyReused(OndeletteError):
    """The key was used with another body."""


class Claims:
    """Who used which key for which body and job."""

    def __init__(self, redis: Redis, settings: QueueSettings) -> None:
        self._redis = redis
        self._prefix = settings.prefix

    def take(self, key: str, body: bytes, job_id: str) -> str:
        """Claim ``key`` for a new job; return ``job_id``, or the id of the job that was made with it before.

        Raises KeyInFlight and KeyReused. A claim that is neither settled nor released lapses after a minute.
        """
        name = self._name(key)
        print_ = hashlib.sha256(body).hexdigest()
        claim = json.dumps({"body": print_, "job": job_id, "settled": False})
        if self._redis.set(name, claim, nx=True, ex=_IN_FLIGHT_SECONDS):
            return job_id
        earlier = cast(bytes | None, self._redis.get(name))
        if earlier is None:  # It lapsed in between.
            return self.take(key, body, job_id)
        members = json.loads(earlier)
        if members["body"] != print_:
            raise KeyReused(key)
        if not members["settled"]:
            raise KeyInFlight(key)
        return str(members["job"])

    def settle(self, key: str, body: bytes, job_id: str) -> None:
        """Remember that ``key`` made a job."""
        claim = {"body": hashlib.sha256(body).hexdigest(), "job": job_id, "settled": True}
        self._redis.set(self._name(key), json.dumps(claim), ex=KEPT_SECONDS)

    def release(self, key: str) -> None:
        """Forget a claim whose job could not be queued."""
        self._redis.delete(self._name(key))

    def _name(self, key: str) -> str:
        # Hashed: a key is somebody else's text of any length.
        return f"{self._prefix}key:{hashlib.sha256(key.encode()).hexdigest()}"
