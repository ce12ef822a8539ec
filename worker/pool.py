"""The pool of a worker's children."""

from __future__ import annotations

from typing import Any

from celery.concurrency.prefork import TaskPool
from kombu.asynchronous import get_event_loop


class WatchedPool(TaskPool):
    """Celery's prefork pool, whose children may also die before the broker has answered for the first time.

    Celery learns how to give back the pipes of a child that died when its event loop starts, which is after
    the first connection. A child that is killed before would keep them, so that there are none for the next
    one and the worker ends with StopIteration (celery/celery#6052, seen with Celery 5.7).
    """

    _pool: Any

    def on_start(self) -> None:
        """Fork the children, and watch them."""
        super().on_start()
        self._pool._create_process_handlers(get_event_loop())

    @property
    def num_processes(self) -> int:
        """The number of children, for which a consumer that is being stopped asks when the pool has ended."""
        return int(self.limit)
