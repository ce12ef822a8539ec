"""How a worker speaks with the broker, and comes back to one that was away."""

from __future__ import annotations

from functools import partial
from typing import Any

from celery.worker.consumer import Consumer

from worker.transport import PromptTransport

_PAUSE = {"interval_start": 0.5, "interval_step": 0.5, "interval_max": 2.0}


class PromptConsumer(Consumer):
    """Celery's consumer, which tries to connect every 2 s, however long the broker has been away.

    Its own pauses grow to 30 s, and as long as it pauses nobody renews leases or hears how children end.
    """

    def ensure_connected(self, conn: Any) -> Any:
        """Connect, as often as it takes."""
        # Not by the address: kombu reads the transport of some out of it.
        conn.transport_cls = PromptTransport
        conn.ensure_connection = partial(conn.ensure_connection, **_PAUSE)
        return super().ensure_connected(conn)
