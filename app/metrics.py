"""The numbers of the service as Prometheus reads them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_LATEST as CONTENT_TYPE
from prometheus_client.registry import Collector

from worker.counts import Counts
from worker.queue import JobQueue
from worker.store import JobStore

__all__ = ["CONTENT_TYPE", "exposition"]

_COUNTERS = {
    "attempts": "Starts of jobs.",
    "redeliveries": "Messages that came again because their worker did not acknowledge them.",
    "duplicates": "Messages of jobs that another solve was at; nothing was done.",
    "losses": "Solves that were given up because their worker was lost.",
    "lease_renewals": "Leases renewed by workers.",
    "reclaimed": "Running jobs that were put back because nobody spoke for them.",
    "reused": "Jobs that were ended with the answer of an earlier one.",
    "republished": "Waiting jobs that were published again.",
}
# The field in which a counter is kept, where it is not its name.
_FIELDS: Mapping[str, str] = {"lease_renewals": "renewals"}


def exposition(store: JobStore, queue: JobQueue) -> bytes:
    """Return all numbers as they are now. Raises RedisError where the server does not answer."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Numbers(store.counts(), queue.depth(), queue.workers()))
    return generate_latest(registry)


class _Numbers(Collector):
    """One reading."""

    def __init__(self, counts: Counts, messages: int, workers: Mapping[str, int]) -> None:
        self._counts = counts
        self._gauges = {
            "ondelette_jobs_running": ("Jobs that a worker is at.", counts.running),
            "ondelette_queue_messages": ("Messages that no worker has fetched.", messages),
            "ondelette_oldest_queued_seconds": ("How long the oldest waiting job waits.", counts.oldest),
            "ondelette_workers": ("Workers that are alive.", len(workers)),
            "ondelette_worker_slots": ("Jobs that they solve at a time.", sum(workers.values())),
        }

    def collect(self) -> Iterator[Metric]:
        """Iterate over the families."""
        for name, (explanation, value) in self._gauges.items():
            yield GaugeMetricFamily(name, explanation, value)
        queued = GaugeMetricFamily("ondelette_jobs_queued", "Jobs that wait.", labels=["priority"])
        for priority, waiting in self._counts.queued.items():
            queued.add_metric([priority], waiting)
        yield queued
        for name, explanation in _COUNTERS.items():
            value = self._counts.totals.get(_FIELDS.get(name, name), 0.0)
            yield CounterMetricFamily(f"ondelette_{name}", explanation, value)
        ended = CounterMetricFamily(
            "ondelette_jobs_ended", "Jobs that have ended.", labels=["method", "status", "outcome"]
        )
        for method, status, outcome, number in self._counts.ended():
            ended.add_metric([method, status, outcome], number)
        yield ended
        seconds = HistogramMetricFamily(
            "ondelette_job_seconds",
            "Time from the last start of a job to its end.",
            labels=["method", "outcome"],
        )
        for method, outcome, reached, total in self._counts.durations():
            seconds.add_metric([method, outcome], reached, total)
        yield seconds
