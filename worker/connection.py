"""How this service talks to its Redis server."""

from __future__ import annotations

import os
from collections import deque
from typing import Any

from redis import Redis
from redis.backoff import ExponentialBackoff
from redis.retry import Retry

from worker.address import redis_url
from worker.settings import QueueSettings


class PromptRedis(Redis):
    """redis-py's client, in which a command goes straight to a connection that is held ready.

    redis-py fetches one from its pool, asks the system whether the server has closed it, and keeps an account
    for OpenTelemetry of each step: more than the exchange with a server on the same machine takes. Here a
    connection that was closed is found out by the command, which is then tried again like any other.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._ready: deque[Any] = deque()
        self._process = os.getpid()

    def execute_command(self, *args: Any, **options: Any) -> Any:
        """Send a command and return its answer."""
        connection = self._connection()
        try:
            return connection.retry.call_with_retry(
                lambda: self._exchange(connection, args, options), lambda _: connection.disconnect()
            )
        finally:
            self._ready.append(connection)

    def _connection(self) -> Any:
        if self._process != os.getpid():
            # Those are the parent's.
            self._ready, self._process = deque(), os.getpid()
        try:
            return self._ready.pop()
        except IndexError:
            return self.connection_pool.get_connection()

    def _exchange(self, connection: Any, args: tuple[Any, ...], options: dict[str, Any]) -> Any:
        connection.send_command(*args, **options)
        return self.parse_response(connection, args[0], **options)  # type: ignore[no-untyped-call]


def connect(settings: QueueSettings, retries: int = 1, timeout: float = 5.0) -> Redis:
    """Return a client that waits ``timeout`` seconds for an answer.

    It tries a failed command ``retries`` times more, after 0.1 s, doubling to 2 s.
    """
    return PromptRedis.from_url(
        redis_url(settings.broker),
        socket_timeout=timeout,
        socket_connect_timeout=2.0,
        health_check_interval=25,
        retry=Retry(ExponentialBackoff(cap=2.0, base=0.1), retries),
    )
