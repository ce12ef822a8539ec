"""Numbers over all jobs, counted where a change is made: in the scripts of the store.

They live in one hash beside the jobs, so that they survive every process and are the same for all. Its
fields: ``attempts``, ``redeliveries``, ``duplicates``, ``losses``, ``renewals``, ``reclaimed``,
``republished``, ``reused``; ``ended <method> <status> <outcome>``; and for jobs that were started
``seconds <method> <outcome>`` (their sum) and ``within <method> <outcome> <bucket>`` (how many took at most
so long, and longer than the bucket before).
The outcome of a failed job is the type of its error, of any other its status.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from worker.records import Priority

BUCKETS = ("0.05", "0.1", "0.25", "0.5", "1", "2.5", "5", "10", "30", "60", "300", "1800", "3600")
"""Upper limits of the histogram of durations, in seconds, as they are written; above is ``+Inf``."""


@dataclass(frozen=True, slots=True)
class Counts:
    """How many jobs wait and run, how long the oldest waits (s), and what was counted so far by its field."""

    queued: Mapping[Priority, int]
    running: int
    oldest: float
    totals: Mapping[str, float]

    def ended(self) -> Iterator[tuple[str, str, str, float]]:
        """Iterate over method, status, outcome and number of ended jobs."""
        for name, number in sorted(self.totals.items()):
            if name.startswith("ended "):
                _, method, status, outcome = name.split()
                yield method, status, outcome, number

    def durations(self) -> Iterator[tuple[str, str, list[tuple[str, float]], float]]:
        """Iterate over method, outcome, numbers of jobs up to each bucket (cumulative), sum of seconds."""
        for name, seconds in sorted(self.totals.items()):
            if name.startswith("seconds "):
                _, method, outcome = name.split()
                total = 0.0
                reached = []
                for bucket in (*BUCKETS, "+Inf"):
                    total += self.totals.get(f"within {method} {outcome} {bucket}", 0.0)
                    reached.append((bucket, total))
                yield method, outcome, reached, seconds
