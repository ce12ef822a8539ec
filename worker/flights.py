"""A job that flies the answer of another one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from solvers.flights.fly import FlightsStopped
from solvers.flights.run import run_flights
from solvers.progress import Progress
from solvers.spec import parse_document
from solvers.spec.flights import check_flights
from solvers.verification.flight import FlightError
from worker import outcome
from worker.records import JobRecord


def fly(
    record: JobRecord,
    document: bytes,
    answered: Mapping[str, Any] | None,
    most_bytes: int,
    progress: Progress,
    seconds: float,
) -> outcome.Outcome:
    """Fly the answer in the result ``answered`` as ``document`` says, and return the end of the job.

    ``answered`` is None where the result is not kept any more; that of this job may have ``most_bytes``.
    """
    source = str(record.flights_of)
    if answered is None:
        return outcome.of_missing_source(source)
    spec = check_flights(parse_document(document), answered["resolved"]["document"])
    try:
        flights = run_flights(spec, answered, progress, seconds)
    except FlightsStopped as stopped:
        return outcome.of_stopped_flights(stopped)
    except FlightError as error:
        return outcome.of_lost_flights(error)
    return outcome.of_flights(flights, record.id, source, most_bytes)
