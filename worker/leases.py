"""The leases of a worker: while it is alive, nobody else is given what it holds.

The broker delivers a message again when nobody has acknowledged it for the visibility timeout, counted from
the delivery. Celery never counts anew (celery/celery#5935), so that the timeout would have to be longer than
the longest job, and a job whose worker was killed would wait as long. Here the timeout is short, and the main
process of every worker says again and again that it still holds its messages and that its children still
solve their jobs. It does so in the event loop that hands out the messages: one that hangs loses its leases.
"""

from __future__ import annotations

from typing import Any

from celery import bootsteps
from celery.worker import state

from worker.store import JobStore, solver_of


def leases(store: JobStore, period: float) -> type[bootsteps.StartStopStep]:
    """Return the step of Celery's consumer that renews the leases every ``period`` seconds."""

    class Leases(bootsteps.StartStopStep):
        """Renews from the moment at which messages are fetched until the consumer stops."""

        requires = ("celery.worker.consumer.tasks:Tasks",)
        _entry: Any = None  # as long as nothing was fetched

        def start(self, consumer: Any) -> None:
            """Renew at once, for the broker may have been away, then regularly on the consumer's timer."""

            def renew() -> None:
                store.renew(
                    [
                        (request.id, request.message.delivery_tag, _solver(request))
                        for request in tuple(state.reserved_requests)
                    ]
                )

            renew()
            self._entry = consumer.timer.call_repeatedly(period, renew)

        def stop(self, consumer: Any) -> None:
            """Renew no more."""
            if self._entry is not None:
                self._entry.cancel()

    return Leases


def _solver(request: Any) -> str:
    return solver_of(request.hostname, request.worker_pid)
