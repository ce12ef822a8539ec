"""Runs of one search side by side, each in a process of its own."""

from __future__ import annotations

from contextlib import ExitStack
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Any, Self

from solvers.companion import GLANCE, Companion
from solvers.genetic.record import Record
from solvers.genetic.run import Order
from solvers.phases.trajectory import AnyTrajectory


class Islands:
    """So many processes (``count``) that do runs; a context manager, which ends them.

    ``records``: what they have told about every run that was ordered, by its number.
    """

    def __init__(self, document: dict[str, Any], earlier: AnyTrajectory | None, count: int) -> None:
        self._message, self._count = (document, earlier), count
        self._open = ExitStack()
        self._busy: dict[Connection, int | None] = {}
        self._companions: dict[Connection, Companion] = {}
        self.records: dict[int, Record] = {}

    def may_begin(self, first: int) -> bool:
        """Whether an island has nothing to do, and not too many runs went on ahead of the ``first`` one."""
        return None in self._busy.values() and len(self.records) < first + 2 * self._count

    def order(self, order: Order) -> None:
        """Give an idle island a run. Raises CompanionError where its process has ended."""
        connection = next(key for key, number in self._busy.items() if number is None)
        self._companions[connection].send(order)
        self._busy[connection] = order.number
        self.records[order.number] = Record()

    def listen(self) -> None:
        """Wait a moment for what islands tell. Raises CompanionError where one has ended or failed."""
        for connection in wait([*self._busy], GLANCE):
            assert isinstance(connection, Connection)
            number, part = self._companions[connection].receive()
            self.records[number].append(part)
            if part.ended:
                self._busy[connection] = None

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            for _ in range(self._count):
                companion = opened.enter_context(Companion("solvers.genetic.island_process"))
                companion.send(self._message)
                self._companions[companion.connection] = companion
                self._busy[companion.connection] = None
            self._open = opened.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()
