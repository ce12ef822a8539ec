"""How a running solve tells the store where it stands and hears that it should stop."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Sequence
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


class _Watcher:
    """The thread of this process that looks after its solves.

    It looks every `LISTEN`, and for a while after the last solve as well: to wake a thread, let alone to
    start one, takes longer than all that it does for a small job.
    """

    _RESTS = 2.0  # seconds without a solve

    def __init__(self) -> None:
        self._watched: set[StoreProgress] = set()
        self._thread: threading.Thread | None = None
        self._wanted = threading.Event()

    def watch(self, progress: StoreProgress) -> None:
        """Look after a solve from now on; raises RuntimeError if no thread can be started."""
        if self._thread is None or not self._thread.is_alive():
            thread = threading.Thread(target=self._run, name="progress", daemon=True)
            thread.start()
            self._thread = thread
        self._watched.add(progress)
        if not self._wanted.is_set():
            self._wanted.set()

    def leave(self, progress: StoreProgress) -> None:
        """Look after a solve no more."""
        self._watched.discard(progress)

    def _run(self) -> None:
        rests = time.monotonic() + self._RESTS
        while True:
            watched = tuple(self._watched)
            time.sleep(min([LISTEN, *(progress.period for progress in watched)]))
            for progress in watched:
                progress.look()
            if watched:
                rests = time.monotonic() + self._RESTS
            elif time.monotonic() > rests:
                self._wanted.clear()
                # One that came in between saw that it was not to wake us.
                if not self._watched:
                    self._wanted.wait()


_WATCHER = _Watcher()


class StoreProgress:
    """Progress of one solve, kept in the store; a context manager around the solve.

    The solve itself only writes and reads memory. Every `LISTEN` a thread asks the store whether to go on;
    every `PERIOD` it tells with that the last report, and the iterations since the one before.
    So a slow or absent server never holds up an iteration. While the server is away the solve goes on and
    nothing is written; it cannot be cancelled then either. What is `untold` at the end is written with it.
    """

    def __init__(
        self, store: JobStore, job_id: str, owner: str, period: float = PERIOD, patience: float = PATIENCE
    ) -> None:
        self._store = store
        self._job_id = job_id
        self._owner = owner
        self.period = period
        """Seconds between two reports."""
        self._patience = patience
        self._latest: ProgressReport | None = None
        self._written: ProgressReport | None = None
        self._iterates: deque[ProgressReport] = deque()
        self._untold: list[ProgressReport] = []
        self._stop = threading.Event()
        self._asked_at: float | None = None
        self._heard_at: float | None = None
        self._away = False
        self._told_at = time.monotonic()
        # Held while the store is asked, and by the end of the solve, after which it is asked no more.
        self._asking = threading.Lock()
        self._over = False
        self._failure: Exception | None = None

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
        _WATCHER.watch(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _WATCHER.leave(self)
        with self._asking:
            self._over = True
        if self._failure is not None:
            raise self._failure

    def look(self) -> None:
        """Ask the store whether to go on, and tell what is new if it is time for that."""
        with self._asking:
            if self._over:
                return
            try:
                self._try_exchange(telling=time.monotonic() - self._told_at >= self.period)
            except Exception as error:  # noqa: BLE001  (raised at the end of the solve: it may lack memory)
                self._over, self._failure = True, error

    def untold(self) -> tuple[ProgressReport | None, Sequence[ProgressReport]]:
        """Return the last report and the iterations before it, as far as the store was not told of them."""
        latest = self._latest
        if latest is self._written:
            return None, ()
        while self._iterates:
            self._untold.append(self._iterates.popleft())
        self._untold = self._untold[-1 :: -(len(self._untold) // MOST_ITERATES + 1)][::-1]
        return latest, self._untold

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
        latest, iterates = self.untold() if telling else (None, ())
        before = self._written
        if latest is not None:
            # Already now: what is reported meanwhile is not to hand on a trajectory that is being told.
            self._written = latest
        try:
            answer = self._store.report(self._job_id, self._owner, latest, iterates)
        except Exception:
            self._written = before
            raise
        if latest is not None:
            self._untold = []
            self._told_at = time.monotonic()
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
