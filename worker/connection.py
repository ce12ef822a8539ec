"""How this service talks to its Redis server."""

from __future__ import annotations

from redis import Redis
from redis.backoff import ExponentialBackoff
from redis.retry import Retry

from worker.address import redis_url
from worker.settings import QueueSettings


def connect(settings: QueueSettings, retries: int = 1, timeout: float = 5.0) -> Redis:
    """Return a client that waits ``timeout`` seconds for an answer.

    It tries a failed command ``retries`` times more, after 0.1 s, doubling to 2 s.
    """
    return Redis.from_url(
        redis_url(settings.broker),
        socket_timeout=timeout,
        socket_connect_timeout=2.0,
        health_check_interval=25,
        retry=Retry(ExponentialBackoff(cap=2.0, base=0.1), retries),
    )
