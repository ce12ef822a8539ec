"""How a solve, or the failure to make one, becomes the end of a job."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from solvers.errors import DocumentError
from solvers.spec import answer_digest
from solvers.status import SolveStatus
from worker.records import FailureType, JobError, JobStatus
from worker.store import compress
from worker.sweeps import figures_of

if TYPE_CHECKING:
    from solvers.solution import Solution

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


def of_solution(solution: Solution, job_id: str, limit: int) -> Outcome:
    """Return the end of a job that was solved; a compressed result over ``limit`` bytes fails it."""
    members = solution.result(job_id)
    figures = figures_of(members)
    result = compress(json.dumps(members, allow_nan=False, separators=(",", ":")).encode())
    if len(result) > limit:
        detail = (
            f"The compressed result has {len(result) / 2**20:.3g} MiB, the limit is {limit / 2**20:.3g} MiB. "
            "Ask for fewer nodes or fewer output samples."
        )
        return _failure(FailureType.INTERNAL, "The result is too large to be kept.", detail)
    if solution.status is SolveStatus.CONVERGED:
        digest = answer_digest(members["resolved"]["document"])
        return Outcome(JobStatus.SUCCEEDED, result=result, figures=figures, digest=digest)
    if solution.status is SolveStatus.CANCELLED:
        return Outcome(JobStatus.CANCELLED, result=result, figures=figures)
    error = JobError(FailureType(solution.status.value), _title(solution.status), solution.message)
    return Outcome(JobStatus.FAILED, error, result, figures)


def of_exception(error: Exception, job_id: str) -> Outcome:
    """Return the end of a job whose solve gave no iterate; the unexpected is logged with its trace."""
    # CasADi and IPOPT say it in C++ words.
    if isinstance(error, MemoryError) or "bad_alloc" in str(error):
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
