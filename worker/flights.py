"""A job that flies the answer of another one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from solvers.flight import FlightError
from solvers.flights.fly import FlightsStopped
from solvers.flights.run import run_flights
from solvers.progress import Progress
from solvers.spec import parse_document
from solvers.spec.flights import check_flights
from worker import outcome
from worker.errors import JobGone, JobNotFound, ResultLost
from worker.store import JobStore


def read_source(store: JobStore, source: str) -> Mapping[str, Any] | None:
    """Return the result of the job whose answer is flown, None where it is not there any more."""
    try:
        text = store.result(source)
    except (JobNotFound, JobGone, ResultLost):
        return None
    return None if text is None else dict(json.loads(text))


@dataclass(frozen=True, slots=True)
class FlightsJob:
    """A job that flies the answer of the job ``source`` as ``document`` says; ``most_bytes`` of result."""

    job_id: str
    source: str
    document: bytes
    most_bytes: int

    def run(self, answered: Mapping[str, Any] | None, progress: Progress, seconds: float) -> outcome.Outcome:
        """Fly the answer in the result ``answered``, and return the end of the job."""
        if answered is None:
            return outcome.of_missing_source(self.source)
        spec = check_flights(parse_document(self.document), answered["resolved"]["document"])
        try:
            flights = run_flights(spec, answered, progress, seconds)
        except FlightsStopped as stopped:
            return outcome.of_stopped_flights(stopped)
        except FlightError as error:
            return outcome.of_lost_flights(error)
        return outcome.of_flights(flights, self.job_id, self.source, self.most_bytes)
