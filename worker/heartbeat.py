"""The sign of life of a worker: written by its main loop, so that a loop that hangs falls silent."""

from __future__ import annotations

import logging
from typing import Any

from celery import bootsteps
from redis.exceptions import RedisError

from worker.queue import JobQueue

logger = logging.getLogger(__name__)

BEATS_TO_MISS = 3


def heartbeat(queue: JobQueue, slots: int, period: float) -> type[bootsteps.StartStopStep]:
    """Return the step of Celery's consumer that beats every ``period`` seconds for a worker of ``slots``."""

    class Heartbeat(bootsteps.StartStopStep):
        """Beats from the moment at which messages are fetched until the consumer stops."""

        requires = ("celery.worker.consumer.tasks:Tasks",)
        _entry: Any = None  # as long as nothing was fetched

        def start(self, consumer: Any) -> None:
            """Beat once, then regularly on the consumer's timer (which logs an error and goes on)."""

            def beat() -> None:
                queue.beat(consumer.hostname, slots, BEATS_TO_MISS * period)

            beat()
            self._entry = consumer.timer.call_repeatedly(period, beat)

        def stop(self, consumer: Any) -> None:
            """Fall silent at once rather than after the missed beats."""
            if self._entry is not None:
                self._entry.cancel()
            try:
                queue.leave(consumer.hostname)
            except RedisError as error:
                logger.warning("no farewell, the server does not answer (%s)", error)

    return Heartbeat
