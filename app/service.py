"""What the routes work with: the store, the queue, and how a document becomes a job."""

from __future__ import annotations

import contextlib
import json
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, cast

from fastapi import Depends, Request

from app.answers import Answers
from app.auth import Doorkeeper, Principal, read_bootstrap_key
from app.egress import networks_of
from app.errors import ServiceError
from app.line import Line
from app.seats import Seats
from app.settings import Settings
from app.watch import StatusWatch
from app.webhooks import Webhooks, read_secrets
from solvers.errors import DocumentError, Fault
from solvers.sizes import ProblemSize, problem_size
from solvers.spec import JobSpec, answer_digest, canonical_json, check_text
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


@dataclass(frozen=True, slots=True)
class Service:
    """One for each process; everything in it may be used by many threads."""

    settings: Settings
    store: JobStore
    sweeps: SweepStore
    queue: JobQueue
    line: Line
    answers: Answers
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
        line = Line(queue)
        return cls(
            settings,
            store,
            sweeps,
            queue,
            line,
            Answers(store, line),
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
            # However it is written: a client's library may not write it twice in the same way.
            lambda: canonical_json(json.loads(body)),
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
        said: Callable[[], str],
        new_id: str,
        make: Callable[[str], None],
        made: Callable[[str], bool],
    ) -> str:
        """Make something with ``new_id``, or with the id that the client's ``key`` was bound to before.

        With one key only the same may be ``said``. Returns the id. Nothing is done if it was ``made``, be it
        by a process that did not live to say so.
        """
        if key is None:
            make(new_id)
            return new_id
        bound, settled = self.claims.take(key, said().encode(), new_id)
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
        most, room = self.settings.project_jobs, self.settings.queued_jobs
        active, waiting = self.store.burden(project, most - count + 1)
        more = "" if count == 1 else f", and these would be {count:,} more"
        if active + count > most:
            detail = f"{active:,} jobs of this project are active{more}; at most {most:,} may be."
            raise ServiceError("quota-exceeded", detail, headers={"Retry-After": "10"})
        if waiting + count > room:
            detail = f"{waiting:,} jobs wait{more}; the queue takes {room:,}."
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
        earlier = self.store.answered(record.project, answer_digest(resolution.document))
        if earlier is None:
            return None
        try:
            text = self.store.kept_result(earlier)
        except ResultsUnavailable as error:
            logger.warning("job %s is solved instead of answered: %s", record.id, error)
            return None
        if text is None:
            return None
        # The answer is the earlier one's, the document and its labels are this one's.
        own = {"job_id": record.id, "reused_from": earlier, "resolved": resolution.to_dict()}
        result = json.dumps(json.loads(text) | own, allow_nan=False, separators=(",", ":"))
        return earlier, result.encode()


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


def service_of(request: Request) -> Service:
    """Return the service of the process that answers a request."""
    return cast(Service, request.app.state.service)


# Not a plain function: that would be called in another thread.
async def _service(request: Request) -> Service:
    return service_of(request)


Shared = Annotated[Service, Depends(_service)]
"""The process's service, as a parameter of a route."""
