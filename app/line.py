"""How long jobs wait."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from worker.queue import JobQueue
from worker.records import JobRecord, JobStatus

_LONGEST_RETRY = 300
_RECENT = 0.5  # seconds for which the length of the line is taken to be what it was


@dataclass(slots=True)
class Line:
    """How many jobs wait for each that can be solved at a time, asked for at most twice a second."""

    queue: JobQueue
    _depth: int = 0
    _slots: int = 1
    _until: float = -math.inf

    def joined(self) -> None:
        """Note that one more job waits."""
        self._depth += 1

    def length(self) -> float:
        """Return it as it was just now."""
        now = time.monotonic()
        if now >= self._until:
            self._depth, self._slots = self.queue.depth(), sum(self.queue.workers().values()) or 1
            self._until = now + _RECENT
        return self._depth / self._slots

    def retry_after(self, record: JobRecord) -> int:
        """Return after how many seconds it is worth asking for an active job again."""
        seconds = record.estimate
        if record.status is JobStatus.QUEUED:
            # Those ahead are unknown to us; they are taken to be like this one.
            seconds *= 1 + self.length()
        elif record.started_at is not None:
            seconds -= time.time() - record.started_at
        return max(1, min(_LONGEST_RETRY, math.ceil(seconds)))
