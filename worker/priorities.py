"""Urgent jobs first, and nobody for ever last: three queues and the order in which a worker asks them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

from worker.records import Priority

_TURNS = (
    Priority.HIGH,
    Priority.NORMAL,
    Priority.HIGH,
    Priority.LOW,
    Priority.HIGH,
    Priority.NORMAL,
    Priority.HIGH,
)


def queue_of(priority: Priority) -> str:
    """Return the name of the queue in which jobs of a priority wait."""
    return f"solve.{priority}"


class Turns:
    """The order in which kombu asks the queues for the next message (its ``queue_order_strategy``).

    Of seven messages that a worker fetches while jobs of all priorities wait, four are of high, two of normal
    and one of low priority. A queue that is empty at its turn leaves it to the most urgent job there is.
    """

    def __init__(self, queues: Sequence[str] = ()) -> None:
        self._queues = set(queues)
        self._turns = cycle(_TURNS)
        self._turn = next(self._turns)

    def update(self, queues: Sequence[str]) -> None:
        """Ask these queues from now on."""
        self._queues = set(queues)

    def consume(self, count: int) -> list[str]:
        """Return the first ``count`` queues to ask, in order."""
        order = [self._turn, *(priority for priority in Priority if priority is not self._turn)]
        return [name for name in map(queue_of, order) if name in self._queues][:count]

    def rotate(self, queue: str) -> str:
        """Go on to the next turn: a message has come from ``queue``."""
        self._turn = next(self._turns)
        return queue
