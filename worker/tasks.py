"""The one task of the queue: solve a recorded job and write how it ended.

Imports the solvers, and with them CasADi: only worker processes import this module.
"""

from __future__ import annotations

import json
import logging
from typing import Any, cast

from celery import Task
from celery.exceptions import Reject
from celery.worker.request import Request
from redis.exceptions import RedisError

from solvers.solve import solve
from solvers.spec import check_document, parse_document
from solvers.trajectory import Trajectory
from worker import outcome
from worker.errors import JobGone, JobNotFound
from worker.progress import StoreProgress
from worker.queue import SOLVE_TASK
from worker.store import JobStore

logger = logging.getLogger(__name__)


def solve_job(job_id: str, store: JobStore, result_limit: int) -> None:
    """Solve a job if there is something to solve, and write its end once.

    Never raises for what a document or a solve does wrong: that is the end of the job. Raises RedisError if
    the store stays away; the job is then as it was and its message may be delivered again.
    """
    owner = store.start(job_id)
    if owner is None:
        logger.info("job %s: nothing to solve", job_id)
        return
    with StoreProgress(store, job_id, owner) as progress:
        try:
            spec = check_document(parse_document(store.document(job_id)))
            solution = solve(spec, progress, earlier_answer(store, spec.warm_start))
            end = outcome.of_solution(solution, job_id, result_limit)
        except RedisError:
            raise
        except Exception as error:  # noqa: BLE001  (logged and written as the job's error)
            end = outcome.of_exception(error, job_id)
    if store.finish(job_id, owner, end.status, end.error, end.result):
        logger.info("job %s: %s", job_id, end.status)
    else:
        logger.warning("job %s ended elsewhere meanwhile; this end (%s) is not written", job_id, end.status)


def earlier_answer(store: JobStore, job_id: str | None) -> Trajectory | None:
    """Return the answer of the job to start from, None if none is named or it is not there any more."""
    if job_id is None:
        return None
    try:
        result = store.result(job_id)
    except (JobNotFound, JobGone):
        return None
    return None if result is None else Trajectory.from_result(json.loads(result))


class JobRequest(Request):
    """A message in the worker's main process, which speaks for a child that cannot speak any more."""

    def on_timeout(self, soft: bool, timeout: float) -> None:
        """Write the end of a job whose child was killed because it overstayed the hard time limit."""
        if not soft:
            self._tell(lambda store: store.fail(self.id, outcome.TIMED_OUT))
        super().on_timeout(soft, timeout)

    def cancel(self, pool: Any, signal: Any = None, emit_retry: bool = True) -> None:
        """End the child because the worker shuts down; the message goes back and the job with it."""
        super().cancel(pool, signal, emit_retry)
        self._tell(lambda store: store.hand_back(self.id))

    def _tell(self, write: Any) -> None:
        try:
            write(cast(SolveTask, self.task).store)
        except RedisError:
            # The main process must live on; the job's next start finds a lost worker instead.
            logger.exception("job %s: the store does not answer", self.id)


class SolveTask(Task):  # type: ignore[type-arg]
    """``ondelette.solve(job_id)``; message and job have the same id."""

    name = SOLVE_TASK
    Request = JobRequest  # type: ignore[assignment]  # Celery takes a class as well as its name.

    def __init__(self, store: JobStore, result_limit: int) -> None:
        self.store = store
        self._result_limit = result_limit

    def run(self, job_id: str) -> None:
        """Solve the job; gives the message back if the store stays away."""
        try:
            solve_job(job_id, self.store, self._result_limit)
        except RedisError as error:
            logger.exception("job %s: the store does not answer; the message goes back", job_id)
            raise Reject(str(error), requeue=True) from error
