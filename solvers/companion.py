"""A process of our own beside this one, for work that goes on at the same time.

Started as a program, not by ``multiprocessing``: a worker's child is daemonic and may not have such children.
The pipe is its only tie: when the other end closes, be it because that process was killed, this one ends at
once, even in the middle of its work.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Self

from solvers.errors import OndeletteError

GLANCE = 0.02
"""Seconds between two looks at whether somebody wants to stop, while a companion works."""


class CompanionError(OndeletteError):
    """The process has ended, or failed by an error of ours."""


@dataclass(frozen=True)
class Failure:
    """An answer that could not be had, and why."""

    detail: str


class Companion:
    """Runs ``module`` beside this process, which calls :func:`serve`; a context manager, which ends it."""

    def __init__(self, module: str) -> None:
        self.connection, there = multiprocessing.Pipe()
        with there:
            self._process = subprocess.Popen(  # noqa: S603  (our own interpreter and module)
                [sys.executable, "-m", module, str(there.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[there.fileno()],
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """The process's id."""
        return self._process.pid

    def send(self, message: Any) -> None:
        """Hand something over. Raises CompanionError where the process has ended."""
        try:
            self.connection.send(message)
        except OSError as error:
            raise CompanionError("the process has ended") from error

    def answered(self, seconds: float) -> bool:
        """Whether there is an answer within so many seconds. Raises CompanionError."""
        try:
            return self.connection.poll(seconds)
        except OSError as error:
            raise CompanionError("the process has ended") from error

    def receive(self) -> Any:
        """Wait for the next answer. Raises CompanionError where the process has ended or failed."""
        try:
            answer = self.connection.recv()
        except (EOFError, OSError) as error:
            raise CompanionError("the process has ended") from error
        if isinstance(answer, Failure):
            raise CompanionError(f"the process failed: {answer.detail}")
        return answer

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.connection.close()
        self._process.kill()
        self._process.wait()


def serve(descriptor: int) -> tuple[Connection, queue.SimpleQueue[Any]]:
    """The side of the process itself: where to send answers, and what comes in.

    The socket ``descriptor`` is its only argument. Messages are taken by a thread, which ends the process
    when nobody can send any more.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who started it decides
    connection = Connection(descriptor)
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(connection, messages), daemon=True).start()
    return connection, messages


def _listen(connection: Connection, messages: queue.SimpleQueue[Any]) -> None:
    try:
        while True:
            messages.put(connection.recv())
    except (EOFError, OSError):
        os._exit(0)
