"""What the routes work with: the store, the queue, and how a document becomes a job."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, cast

from fastapi import Depends, Request

from app.auth import Doorkeeper, Principal, read_bootstrap_key
from app.egress import networks_of
from app.errors import ServiceError
from app.seats import Seats
from app.settings import Settings
from app.watch import StatusWatch
from app.webhooks import Webhooks, read_secrets
from solvers.errors import DocumentError, Fault
from solvers.phases.trajectory import AnyTrajectory
from solvers.phases.trajectory import trajectory_of as read_trajectory
from solvers.sizes import ProblemSize, problem_size
from solvers.spec import JobSpec, answer_digest, check_text
from worker.claims import Claims
from worker.errors import JobGone, JobNotFound, QueueUnavailable, ResultsUnavailable
from worker.keys import KeyStore, digest
from worker.queue import JobQueue
from worker.rates import RateLimiter
from worker.reconciler import Reconciler
from worker.records import JobRecord, JobStatus, Priority, SweepPlace
from worker.store import JobStore, connect
from worker.sweeps import SweepStore

logger = logging.getLogger(__name__)

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


@dataclass(frozen=True, slots=True)
class Service:
    """One for each process; everything in it may be used by many threads."""

    settings: Settings
    store: JobStore
    sweeps: SweepStore
    queue: JobQueue
    line: Line
    claims: Claims
    doorkeeper: Doorkeeper
    webhooks: Webhooks
    watch: StatusWatch
    seats: Seats
    reconciler: Reconciler

    @classmethod
    def of(cls, settings: Settings) -> Service:
        """Return the service for a broker; nothing is connected before it is used."""
        # Somebody waits for the answer: a server that does not answer soon is away.
        redis = connect(settings, timeout=3.0)
        store = JobStore(redis, settings)
        queue = JobQueue(redis, settings)
        sweeps = SweepStore(store, settings)
        keys, rates = KeyStore(redis, settings), RateLimiter(redis, settings)
        secrets = settings.webhook_secret_file
        file = settings.bootstrap_key_file
        bootstrap = None if file is None else digest(read_bootstrap_key(file))
        return cls(
            settings,
            store,
            sweeps,
            queue,
            Line(queue),
            Claims(redis, settings),
            Doorkeeper(settings, keys, rates, store, sweeps, bootstrap),
            Webhooks(
                store,
                store.hooks,
                () if secrets is None else read_secrets(secrets),
                networks_of(settings.webhook_networks),
            ),
            StatusWatch(store, settings),
            Seats(settings.project_waiting, settings.process_waiting),
            Reconciler(store, queue, settings.visibility_seconds, settle=settings.reconcile_seconds / 2),
        )

    def close(self) -> None:
        """Close the connections."""
        self.store.redis.close()

    def submit(self, body: bytes, key: str | None, principal: Principal, new_id: str) -> JobRecord:
        """Check a document, remember it and put it into the queue; return the job of ``principal``.

        Its id is ``new_id``. ``key`` is the client's Idempotency-Key: the job of an earlier submission with
        it is returned instead. Raises DocumentError, KeyReused, KeyInFlight, ServiceError for one job too
        many, and RedisError.
        """
        spec, size = self.check(body, principal)
        record = new_record(new_id, spec, size, principal)
        job_id = self.once(
            key,
            body,
            record.id,
            lambda job_id: self._make(replace(record, id=job_id), spec, body),
            self.store.exists,
        )
        return record if job_id == record.id and not spec.reuse else self.store.get(job_id)

    def check(self, body: bytes, principal: Principal) -> tuple[JobSpec, ProblemSize]:
        """Return the checked form of a document and its size; raises DocumentError with every fault."""
        spec = check_text(body)
        size = problem_size(spec)
        self.find_start(spec, principal)
        self.check_webhook(spec)
        return spec, size

    def once(
        self,
        key: str | None,
        body: bytes,
        new_id: str,
        make: Callable[[str], None],
        made: Callable[[str], bool],
    ) -> str:
        """Make something with ``new_id``, or with the id that the client's ``key`` was bound to before.

        Returns the id. Nothing is done if it was ``made``, be it by a process that did not live to say so.
        """
        if key is None:
            make(new_id)
            return new_id
        bound, settled = self.claims.take(key, body, new_id)
        if settled:
            return bound
        try:
            if not made(bound):
                make(bound)
        except Exception:
            self.claims.release(key)
            raise
        self.claims.settle(key)
        return bound

    def admit(self, project: str, count: int) -> None:
        """Refuse ``count`` more jobs where a project has its share of active ones or the queue is full."""
        room = self.settings.project_jobs - count
        active, waiting = self.store.burden(project, room + 1)
        if active > room:
            detail = (
                f"{active:,} jobs of this project are active; at most {self.settings.project_jobs:,} may be."
            )
            raise ServiceError("quota-exceeded", detail, headers={"Retry-After": "10"})
        if waiting + count > self.settings.queued_jobs:
            detail = f"{waiting:,} jobs wait; the queue takes {self.settings.queued_jobs:,}."
            raise ServiceError("queue-full", detail, headers={"Retry-After": "30"})

    def check_webhook(self, spec: JobSpec) -> None:
        """Refuse a document that wants somebody to be told whom this service does not tell anything."""
        reason = None if spec.webhook is None else self.webhooks.refusal(spec.webhook.url)
        if reason is not None:
            enabled = self.webhooks.enabled
            fault = Fault("/webhook/url", reason) if enabled else Fault("/webhook", reason, "unsupported")
            raise DocumentError([fault])

    def find_start(self, spec: JobSpec, principal: Principal) -> None:
        """Refuse a document that wants to start from a job that is unknown or has no result yet."""
        if spec.warm_start is None:
            return
        try:
            record = self.store.get(spec.warm_start)
            # Flights have no trajectory of their own.
            there = record.flights_of is None and principal.only in (None, record.project)
        except (JobNotFound, JobGone):
            there = False
        if not there or self.store.kept_result(spec.warm_start) is None:
            detail = "no job with this id has a result; submit again when it has, or leave the key out"
            raise DocumentError([Fault("/warm_start", detail)])

    def _make(self, record: JobRecord, spec: JobSpec, body: bytes) -> None:
        earlier = self._earlier(record, spec) if spec.reuse else None
        if earlier is None:
            self.queue_job(record, body)
            return
        self.queue_job(record, body, publish=False)
        try:
            self.store.answer(record.id, *earlier)
        except ResultsUnavailable as error:
            logger.warning("job %s is solved instead of answered: %s", record.id, error)
            # Not even now is a job lost whose message the broker does not take: the reconciler finds it.
            with contextlib.suppress(QueueUnavailable):
                self.queue.enqueue(record)

    def queue_job(self, record: JobRecord, body: bytes, *, publish: bool = True) -> None:
        """Remember a job and put it into the queue, in one step; raises ServiceError for one too many."""
        most = self.settings.project_jobs, self.settings.queued_jobs
        publication = self.queue.publication(record) if publish else None
        while not self.store.add(record, body, publication, most):
            # It counts exactly, and refuses or makes room.
            self.admit(record.project, 1)
        self.line.joined()

    def _earlier(self, record: JobRecord, spec: JobSpec) -> tuple[str, bytes] | None:
        """Return an earlier job that answered the same question, and its answer as one of ``record``."""
        resolution = spec.resolved()
        earlier = self.store.answered(answer_digest(resolution.document))
        if earlier is None:
            return None
        try:
            text = self.store.kept_result(earlier)
        except ResultsUnavailable as error:
            logger.warning("job %s is solved instead of answered: %s", record.id, error)
            return None
        if text is None or self.store.project(earlier) != record.project:
            return None
        # The answer is the earlier one's, the document and its labels are this one's.
        own = {"job_id": record.id, "reused_from": earlier, "resolved": resolution.to_dict()}
        result = json.dumps(json.loads(text) | own, allow_nan=False, separators=(",", ":"))
        return earlier, result.encode()

    def retry_after(self, record: JobRecord) -> int:
        """Return after how many seconds it is worth asking for an active job again."""
        seconds = record.estimate
        if record.status is JobStatus.QUEUED:
            # Those ahead are unknown to us; they are taken to be like this one.
            seconds *= 1 + self.line.length()
        elif record.started_at is not None:
            seconds -= time.time() - record.started_at
        return max(1, min(_LONGEST_RETRY, math.ceil(seconds)))

    def result(self, job_id: str) -> bytes:
        """Return the JSON text of a job's result; raises ServiceError while, or where, there is none."""
        result = self.store.result(job_id)
        if result is not None:
            return result
        record = self.store.get(job_id)
        if not record.status.final:
            raise self.not_ready(record)
        raise ServiceError("no-result", f"The job {record.status} without any iterate, so it has no result.")

    def ended(self, job_id: str) -> tuple[JobRecord, bytes | None]:
        """Return a job that has ended, and its result if it has one; raises ServiceError for any other.

        Nor is a job of flights told of by this.
        """
        record, text = self.store.get(job_id), self.store.result(job_id)
        if not record.status.final:
            raise self.not_ready(record)
        if record.flights_of is not None:
            raise self.no_answer(record.flights_of)
        return record, text

    def answer(self, job_id: str) -> dict[str, Any]:
        """Return the result of a job that solved a problem; raises ServiceError as `result` does."""
        stored: dict[str, Any] = json.loads(self.result(job_id))
        if stored.get("kind") == "flights":
            raise self.no_answer(stored["flights_of"])
        return stored

    def no_answer(self, source: str) -> ServiceError:
        """Return the refusal of what only a job that solved a problem has, not one that flew ``source``."""
        return ServiceError("no-result", f"The job flew the answer of job {source}; it has none of its own.")

    def not_ready(self, record: JobRecord) -> ServiceError:
        """Return the refusal of what only a final job has."""
        detail = f"The job is {record.status}; its result can be read when its status is final."
        return ServiceError("not-ready", detail, headers={"Retry-After": str(self.retry_after(record))})


def new_record(
    new_id: str, spec: JobSpec, size: ProblemSize, principal: Principal, sweep: SweepPlace | None = None
) -> JobRecord:
    """Return the record of a new job of ``principal`` for a checked document.

    A point of a sweep lets single jobs go first, unless its document says how urgent it is.
    """
    now = time.time()
    patient = sweep is not None and "priority" not in spec.model_fields_set
    return JobRecord(
        id=new_id,
        status=JobStatus.QUEUED,
        method=spec.method.name,
        max_seconds=float(spec.options.max_seconds),
        created_at=now,
        estimate=min(size.seconds, float(spec.options.max_seconds)),
        name=spec.name or None,
        tags=tuple(spec.tags),
        priority=Priority.LOW if patient else Priority(spec.priority),
        deadline_at=None if spec.deadline_seconds is None else now + spec.deadline_seconds,
        sweep=sweep,
        project=principal.project,
        submitted_by=principal.key,
        webhook=None if spec.webhook is None else spec.webhook.url,
    )


def trajectory_of(answer: Mapping[str, Any]) -> AnyTrajectory:
    """Return the trajectory of a result; raises ServiceError for that of an iterate that diverged."""
    try:
        return read_trajectory(answer)
    except TypeError as error:
        raise not_finite() from error


def not_finite() -> ServiceError:
    """Say that the numbers of an iterate that diverged (null in a result) cannot be interpolated."""
    return ServiceError("no-result", "The last iterate is not finite, so it cannot be resampled.")


def service_of(request: Request) -> Service:
    """Return the service of the process that answers a request."""
    return cast(Service, request.app.state.service)


# Not a plain function: that would be called in another thread.
async def _service(request: Request) -> Service:
    return service_of(request)


Shared = Annotated[Service, Depends(_service)]
"""The process's service, as a parameter of a route."""
