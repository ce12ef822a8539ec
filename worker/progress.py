"""How a running solve tells the store where it stands and hears that it should stop."""

from __future__ import annotations

import logging
import math
import os
import signal
import threading
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import TracebackType

from redis.exceptions import RedisError

from solvers.progress import ProgressReport
from worker.records import JobStatus
from worker.store import JobStore, Signal

logger = logging.getLogger(__name__)

PERIOD = 0.2
"""Time between two reports, in seconds: at most five writes a second."""

LISTEN = 0.05
"""Time between two questions whether to stop, in seconds; one costs the server some 20 us."""

PATIENCE = 5.0
"""Time that a solve has to hear that it is cancelled, and then to come to its end, in seconds."""

MOST_ITERATES = 20
"""Most iterates that are told of at one exchange; of more of them, evenly some."""


# The thread of one solve serves the next: to start one takes longer than all that it does for a small job.
_THREADS = ThreadPoolExecutor(thread_name_prefix="progress")


class StoreProgress:
    """Progress of one solve, kept in the store; a context manager around the solve.

    The solve itself only writes and reads memory. Every `LISTEN` a thread asks the store whether to go on;
    every `PERIOD` it tells with that the last report, and the iterations since the one before.
    So a slow or absent server never holds up an iteration. While the server is away the solve goes on and
    nothing is written; it cannot be cancelled then either.
    """

    def __init__(
        self, store: JobStore, job_id: str, owner: str, period: float = PERIOD, patience: float = PATIENCE
    ) -> None:
        self._store = store
        self._job_id = job_id
        self._owner = owner
        self._period = period
        self._patience = patience
        self._latest: ProgressReport | None = None
        self._written: ProgressReport | None = None
        self._iterates: deque[ProgressReport] = deque()
        self._untold: list[ProgressReport] = []
        self._stop = threading.Event()
        self._asked_at: float | None = None
        self._heard_at: float | None = None
        self._away = False
        self._told_at = -math.inf
        self._done = threading.Event()

    def report(self, report: ProgressReport) -> None:
        """Take note of a moment of the solve; written at the next exchange unless another comes first.

        A trajectory is handed on to the one that comes first, for there are few of them.
        """
        latest = self._latest
        if report.trajectory is None and latest is not None and latest is not self._written:
            report = replace(report, trajectory=latest.trajectory)
        self._latest = report
        if report.objective is not None or report.infeasibility is not None:
            self._iterates.append(report)

    def cancelled(self) -> bool:
        """Tell whether somebody asked to cancel the job, or whether it is not this solve's any more."""
        if not self._stop.is_set():
            return False
        if self._heard_at is None:
            self._heard_at = time.monotonic()
        return True

    def __enter__(self) -> StoreProgress:
        try:
            self._watching = _THREADS.submit(self._watch)
        except RuntimeError:
            # No thread could be started for it; the next one that is finds it in the line.
            self._done.set()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._watching.result()

    def _watch(self) -> None:
        while not self._done.wait(min(LISTEN, self._period)):
            self._try_exchange(telling=time.monotonic() - self._told_at >= self._period)
        if self._latest is not self._written and not self._away:
            self._try_exchange(telling=True)

    def _try_exchange(self, *, telling: bool) -> None:
        try:
            self._exchange(telling=telling)
            self._away = False
        except RedisError as error:
            if not self._away:
                logger.warning(
                    "job %s: the store does not answer (%s); the solve goes on", self._job_id, error
                )
            self._away = True

    def _exchange(self, *, telling: bool) -> None:
        """Hear whether to stop, and tell what is new if it is time for that."""
        latest = self._latest
        if telling and latest is not self._written:
            while self._iterates:
                self._untold.append(self._iterates.popleft())
            self._untold = self._untold[-1 :: -(len(self._untold) // MOST_ITERATES + 1)][::-1]
            answer = self._store.report(self._job_id, self._owner, latest, self._untold)
            self._written = latest
            self._untold = []
            self._told_at = time.monotonic()
        else:
            answer = self._store.report(self._job_id, self._owner, None)
        if answer is Signal.GO:
            return
        self._stop.set()
        now = time.monotonic()
        if self._asked_at is None:
            self._asked_at = now
        # A solve that has heard is on its way: it verifies and returns its last iterate.
        elif answer is Signal.CANCEL and now - (self._heard_at or self._asked_at) > self._patience:
            self._end_process()

    def _end_process(self) -> None:
        """End a solve that does not come back to its iterations; only its whole process can be stopped."""
        if self._store.finish(self._job_id, self._owner, JobStatus.CANCELLED):
            logger.warning(
                "job %s did not stop within %s s; its process is ended", self._job_id, self._patience
            )
            os.kill(os.getpid(), signal.SIGKILL)
