"""The pool of a worker's children."""

from __future__ import annotations

from typing import Any

from celery.concurrency.asynpool import AsynPool
from celery.concurrency.prefork import TaskPool
from kombu.asynchronous import get_event_loop

# Seconds that a child has from the end of its pipe to the end of itself, which takes microseconds.
_ENDING = 1.0


class _PromptPool(AsynPool):
    """Celery's pool of processes, which replaces a child at once.

    Celery looks for the child's exit code when its pipe ends. That is some microseconds before there is one,
    so it mostly finds a child that lives, and looks again on a timer of five seconds, during which nothing
    is solved in its place (celery/celery#9588).
    """

    def _event_process_exit(self, hub: Any, proc: Any) -> None:
        proc.join(_ENDING)
        super()._event_process_exit(hub, proc)  # type: ignore[misc]  # celery-types do not know it.


class WatchedPool(TaskPool):
    """Celery's prefork pool, whose children may also die before the broker has answered for the first time.

    Celery learns how to give back the pipes of a child that died when its event loop starts, which is after
    the first connection. A child that is killed before would keep them, so that there are none for the next
    one and the worker ends with StopIteration (celery/celery#6052, seen with Celery 5.7).
    """

    Pool = _PromptPool
    _pool: Any

    def on_start(self) -> None:
        """Fork the children, and watch them."""
        super().on_start()
        self._pool._create_process_handlers(get_event_loop())

    @property
    def num_processes(self) -> int:
        """The number of children, for which a consumer that is being stopped asks when the pool has ended."""
        return int(self.limit)
