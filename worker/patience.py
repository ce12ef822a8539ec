"""How long a solve may take, and how long it waits for a store that is away."""

from __future__ import annotations

import contextlib
import faulthandler
import logging
import signal
import sys
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

from worker.errors import STORE_AWAY

logger = logging.getLogger(__name__)

T = TypeVar("T")

_PAUSE = 0.5


def patiently(ask: Callable[[], T], seconds: float, job_id: str) -> T:
    """Return what ``ask`` returns, asked again and again while the store is away or takes nothing.

    Raises the last error if that lasts for more than ``seconds``. Asking twice must do no harm.
    """
    give_up = time.monotonic() + seconds
    away = False
    while True:
        try:
            return ask()
        except STORE_AWAY as error:
            if time.monotonic() > give_up:
                raise
            if not away:
                logger.warning(
                    "job %s: the store does not answer (%s); trying for %g s", job_id, error, seconds
                )
            away = True
            time.sleep(_PAUSE)


@contextlib.contextmanager
def process_limit(seconds: float) -> Iterator[None]:
    """End this process, with a trace of all its threads on stderr, if the context lasts for ``seconds``.

    A timer of the kernel sends SIGALRM, and its handler needs no interpreter: also a solve that never comes
    back from its library is ended. An alarm that was set before is set again afterwards.
    """
    began = time.monotonic()
    # Celery puts a logger in the place of stderr, which has no file to write to.
    file = sys.__stderr__ or sys.stderr
    # What the signal did before, which is to end the process, it does after the trace is written.
    faulthandler.register(signal.SIGALRM, file=file, all_threads=True, chain=True)
    before, _ = signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        faulthandler.unregister(signal.SIGALRM)
        if before:
            signal.setitimer(signal.ITIMER_REAL, max(1e-3, before - (time.monotonic() - began)))
