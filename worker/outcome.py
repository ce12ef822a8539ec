"""How a solve, or the failure to make one, becomes the end of a job."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import orjson

from solvers.errors import DocumentError
from solvers.spec import answer_digest
from solvers.status import SolveStatus
from worker.records import FailureType, JobError, JobStatus
from worker.store import compress
from worker.sweeps import figures_of

if TYPE_CHECKING:
    from solvers.flights.fly import FlightsStopped
    from solvers.flights.run import Flights
    from solvers.solution import Answer
    from solvers.verification.flight import FlightError

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The end of a job: its final status, why it failed, its compressed result and the figures of it.

    ``digest`` tells what a certified result answers (`answer_digest`).
    """

    status: JobStatus
    error: JobError | None = None
    result: bytes | None = None
    figures: Mapping[str, Any] | None = None
    digest: str | None = None


def _title(status: SolveStatus) -> str:
    """Return what happened, without the advice that follows it."""
    return status.sentence.partition(". ")[0].removesuffix(".") + "."


TIMED_OUT = JobError(
    FailureType.TIME_LIMIT,
    _title(SolveStatus.TIME_LIMIT),
    "The solve did not come back to its iterations in time, so its process was ended; there is no iterate.",
)

ABORTED = JobError(
    FailureType.OUT_OF_MEMORY,
    "The solve's process was aborted.",
    "Its numerical libraries gave up, as they do where no memory is left for them to say so. Ask for fewer "
    "nodes, or let the operator raise the worker's limit (ONDELETTE_MEMORY_MIB).",
)


# CasADi and IPOPT say it in C++ words, the interpreter of a thread whose stack finds no room.
_NO_MEMORY = ("bad_alloc", "can't start new thread", "unable to start watchdog thread")


def of_solution(solution: Answer, job_id: str, limit: int) -> Outcome:
    """Return the end of a job that was solved; a compressed result over ``limit`` bytes fails it."""
    members = solution.result(job_id)
    figures = figures_of(members)
    result = _packed(members)
    if len(result) > limit:
        return _too_large(result, limit, "Ask for fewer nodes or fewer output samples.")
    if solution.status is SolveStatus.CONVERGED:
        digest = answer_digest(members["resolved"]["document"])
        return Outcome(JobStatus.SUCCEEDED, result=result, figures=figures, digest=digest)
    if solution.status is SolveStatus.CANCELLED:
        return Outcome(JobStatus.CANCELLED, result=result, figures=figures)
    error = JobError(FailureType(solution.status.value), _title(solution.status), solution.message)
    return Outcome(JobStatus.FAILED, error, result, figures)


def of_flights(flights: Flights, job_id: str, source: str, limit: int) -> Outcome:
    """Return the end of a job that flew the answer of the job ``source``."""
    result = _packed(flights.result(job_id, source))
    if len(result) > limit:
        return _too_large(result, limit, "Ask for fewer runs.")
    return Outcome(JobStatus.SUCCEEDED, result=result)


def of_stopped_flights(stopped: FlightsStopped) -> Outcome:
    """Return the end of flights that were not all flown: they have no result."""
    if stopped.status is SolveStatus.CANCELLED:
        return Outcome(JobStatus.CANCELLED)
    detail = "Not all flights were flown in time. Ask for fewer runs, or raise max_seconds."
    return _failure(FailureType.TIME_LIMIT, "The time limit was reached.", detail)


def of_lost_flights(error: FlightError) -> Outcome:
    """Return the end of flights of which not even the undisturbed one can be followed."""
    return _failure(FailureType.DIVERGED, "The answer cannot be flown.", f"In short: {error}.")


def of_missing_source(source: str) -> Outcome:
    """Return the end of flights whose answer was erased, or outlived its time, while they waited."""
    detail = f"The result of job {source} is not kept any more."
    return _failure(FailureType.INTERNAL, "There is no answer to be flown.", detail)


def _packed(members: Mapping[str, Any]) -> bytes:
    try:
        text = orjson.dumps(members)
    except orjson.JSONEncodeError:
        # It has no integers of more than 64 bits; the metadata of a document may.
        text = json.dumps(members, allow_nan=False, separators=(",", ":")).encode()
    return compress(text)


def _too_large(result: bytes, limit: int, advice: str) -> Outcome:
    sizes = f"The compressed result has {len(result) / 2**20:.3g} MiB, the limit is {limit / 2**20:.3g} MiB."
    return _failure(FailureType.INTERNAL, "The result is too large to be kept.", f"{sizes} {advice}")


def of_exception(error: Exception, job_id: str) -> Outcome:
    """Return the end of a job whose solve gave no iterate; the unexpected is logged with its trace."""
    if isinstance(error, MemoryError) or any(words in str(error) for words in _NO_MEMORY):
        logger.warning("job %s ran out of memory", job_id)
        return _failure(
            FailureType.OUT_OF_MEMORY,
            "The solve needed more memory than a worker may use.",
            "Ask for fewer nodes, or let the operator raise the worker's limit (ONDELETTE_MEMORY_MIB).",
        )
    logger.error("job %s: unexpected error", job_id, exc_info=error)
    if isinstance(error, DocumentError):
        detail = (
            "The worker refuses a document that was accepted; API and worker may be of different versions."
        )
    else:
        detail = (
            f"An unexpected error ({type(error).__name__}) ended the solve; the worker's log has the details."
        )
    return _failure(FailureType.INTERNAL, "Internal error.", detail)


def _failure(type: FailureType, title: str, detail: str) -> Outcome:
    return Outcome(JobStatus.FAILED, JobError(type, title, detail))
