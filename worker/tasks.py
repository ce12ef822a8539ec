"""The one task of the queue: solve a recorded job and write how it ended.

Imports the solvers, and with them CasADi: only worker processes import this module.
"""

from __future__ import annotations

import json
import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

from celery import Task
from celery.exceptions import Reject, WorkerLostError
from celery.worker.request import Request
from opentelemetry.trace import SpanKind
from redis.exceptions import RedisError

from solvers.phases.trajectory import AnyTrajectory, trajectory_of
from solvers.solve import solve
from solvers.spec import check_text
from solvers.status import SolveStatus
from worker import outcome, traces
from worker.errors import STORE_AWAY
from worker.flights import fly
from worker.logs import about
from worker.messages import REQUEST_HEADER, SOLVE_TASK
from worker.neighbours import Neighbours
from worker.patience import patiently, process_limit
from worker.progress import StoreProgress
from worker.store import Assignment, JobStore, new_owner, solver_of
from worker.sweeps import ending_of

logger = logging.getLogger(__name__)

# Ends of a solve from which the neighbours in a sweep may start: the nonlinear program converged.
_GOOD_STARTS = (SolveStatus.CONVERGED, SolveStatus.UNVERIFIED)


@dataclass(frozen=True, slots=True)
class Limits:
    """What one solve may take.

    ``result_bytes`` of compressed result, ``grace`` seconds beyond the job's ``max_seconds``, after which its
    process ends itself, and ``outage`` seconds to wait for a store that is away.
    """

    result_bytes: int
    grace: float
    outage: float


def solve_job(
    job_id: str,
    store: JobStore,
    limits: Limits,
    solver: str = "",
    *,
    redelivered: bool = False,
    neighbours: Neighbours | None = None,
) -> None:
    """Solve a job if there is something to solve, and write its end once.

    ``solver`` begins the word by which the job is owned, ``redelivered`` is only counted; ``neighbours`` are
    those of the sweep that the job may belong to. Never raises for what a document or a solve does wrong:
    that is the end of the job. Raises one of STORE_AWAY if the store stays away for too long; the
    job is then as it was and its message may be delivered again.
    """
    word = new_owner(solver)
    job = patiently(lambda: store.start(job_id, word, redelivered=redelivered), limits.outage, job_id)
    if job is None:
        logger.info("job %s: nothing to solve", job_id)
        return
    logger.info("job %s: running", job_id)
    progress = StoreProgress(store, job_id, word)
    end = _solve(job, store, limits, neighbours, progress)
    words = (end.status, end.error, end.result, end.digest, progress.untold())
    written = patiently(lambda: store.finish(job_id, word, *words), limits.outage, job_id)
    if written:
        logger.info("job %s: %s", job_id, end.status)
        if neighbours is not None and job.record.sweep is not None:
            ending = ending_of(end.status, end.error, end.figures)
            neighbours.ended(job.record.sweep, job_id, ending)
    else:
        logger.warning("job %s ended elsewhere meanwhile; this end (%s) is not written", job_id, end.status)


def _solve(
    job: Assignment, store: JobStore, limits: Limits, neighbours: Neighbours | None, progress: StoreProgress
) -> outcome.Outcome:
    job_id, seconds = job.record.id, job.record.seconds_left(time.time())
    try:
        # Even its thread may find no memory.
        with progress:
            work = patiently(
                lambda: _prepared(job, store, limits, progress, neighbours, seconds), limits.outage, job_id
            )
            with process_limit(seconds + limits.grace):
                return work()
    except STORE_AWAY:
        raise
    except Exception as error:  # noqa: BLE001  (logged and written as the job's error)
        return outcome.of_exception(error, job_id)


def _prepared(
    job: Assignment,
    store: JobStore,
    limits: Limits,
    progress: StoreProgress,
    neighbours: Neighbours | None,
    seconds: float,
) -> Callable[[], outcome.Outcome]:
    """Read all that a job needs beside its document; return its work, for which there are ``seconds``."""
    record, job_id = job.record, job.record.id
    if record.flights_of is not None:
        source = store.kept_result(record.flights_of)
        answered = None if source is None else json.loads(source)
        return partial(fly, record, job.document, answered, limits.result_bytes, progress, seconds)
    spec, at = check_text(job.document), record.sweep
    if spec.warm_start is None and at is not None and neighbours is not None:
        earlier = neighbours.nearest(at)
    else:
        earlier = earlier_answer(store, spec.warm_start)

    def work() -> outcome.Outcome:
        solution = solve(spec, progress, earlier, seconds)
        if at is not None and neighbours is not None and solution.status in _GOOD_STARTS:
            neighbours.found(at, job_id, solution.trajectory)
        return outcome.of_solution(solution, job_id, limits.result_bytes)

    return work


def earlier_answer(store: JobStore, job_id: str | None) -> AnyTrajectory | None:
    """Return the answer of the job to start from, None if none is named or it is not there any more."""
    result = None if job_id is None else store.kept_result(job_id)
    return None if result is None else trajectory_of(json.loads(result))


class JobRequest(Request):
    """A message in the worker's main process, which speaks for a child that cannot speak any more."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        # Celery only logs that a message could not be acknowledged, and never gets the right back to fetch
        # another in its place: the worker would stand still for ever. An error that is not listed makes it
        # connect anew.
        super().__init__(*args, **kwargs | {"connection_errors": ()})

    def on_accepted(self, pid: str, time_accepted: float) -> None:
        """Note at the broker that the message is held, now that a child is at work."""
        super().on_accepted(pid, time_accepted)
        self.message.channel.qos.note()

    def on_timeout(self, soft: bool, timeout: float) -> None:
        """Write the end of a job whose child was killed because it overstayed the hard time limit."""
        if not soft:
            self._tell(lambda task: task.store.fail(self.id, outcome.TIMED_OUT, self._solver))
        super().on_timeout(soft, timeout)

    def cancel(self, pool: Any, signal: Any = None, emit_retry: bool = True) -> None:
        """End the child because the worker shuts down; the message goes back and the job with it."""
        super().cancel(pool, signal, emit_retry)
        # Any child of ours: one that has just started may not have told its number yet.
        self._tell(lambda task: task.store.hand_back(self.id, solver_of(self.hostname)))

    def on_failure(self, exc_info: Any, send_failed_event: bool = True, return_ok: bool = False) -> None:
        """Note that a child has died, so that the message, which goes back, starts the job anew.

        One that aborted itself would do so again.
        """
        # Billiard wraps some exceptions together with their trace.
        error = getattr(exc_info.exception, "exc", exc_info.exception)
        if isinstance(error, WorkerLostError) and "SIGABRT" in str(error):
            self._tell(lambda task: task.store.fail(self.id, outcome.ABORTED, self._solver))
        elif isinstance(error, WorkerLostError | SystemExit):
            self._tell(
                lambda task: task.store.lose(self.id, self._solver, task.limits.grace, outcome.TIMED_OUT)
            )
        super().on_failure(exc_info, send_failed_event, return_ok)

    @property
    def _solver(self) -> str:
        return solver_of(self.hostname, self.worker_pid)

    def _tell(self, write: Callable[[SolveTask], object]) -> None:
        try:
            write(cast(SolveTask, self.task))
        except RedisError:
            # The main process must live on; nobody renews the job's lease any more, and that tells as well.
            logger.exception("job %s: the store does not answer", self.id)


class SolveTask(Task):  # type: ignore[type-arg]
    """``ondelette.solve(job_id)``; message and job have the same id."""

    name = SOLVE_TASK
    Request = JobRequest  # type: ignore[assignment]  # Celery takes a class as well as its name.

    def __init__(self, store: JobStore, limits: Limits, neighbours: Neighbours | None = None) -> None:
        self.store = store
        self.limits = limits
        self._neighbours = neighbours

    def run(self, job_id: str) -> None:
        """Solve the job; gives the message back if the store stays away."""
        headers = self.request.headers or {}
        with (
            about(request=headers.get(REQUEST_HEADER), job=job_id),
            traces.span("solve", SpanKind.CONSUMER, headers=headers, **{"ondelette.job_id": job_id}),
        ):
            self._solve(job_id)

    def _solve(self, job_id: str) -> None:
        try:
            solver = solver_of(self.request.hostname, os.getpid())
            redelivered = bool((self.request.delivery_info or {}).get("redelivered"))
            solve_job(
                job_id,
                self.store,
                self.limits,
                solver,
                redelivered=redelivered,
                neighbours=self._neighbours,
            )
        except STORE_AWAY as error:
            logger.exception("job %s: the store does not answer; the message goes back", job_id)
            raise Reject(str(error), requeue=True) from error
