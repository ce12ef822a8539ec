"""How flights of an answer become a job."""

from __future__ import annotations

import time
from dataclasses import replace

from app.answers import not_finite, trajectory_of
from app.auth import Principal
from app.service import Service
from solvers.spec import canonical_json, parse_document
from solvers.spec.flights import FlightsSpec, check_flights
from worker.records import JobRecord, JobStatus

METHOD = "flights"
"""What stands for the method of such a job."""

_SECONDS_PER_RUN = 2e-3


def submit_flights(
    service: Service, source: str, body: bytes, key: str | None, principal: Principal, new_id: str
) -> JobRecord:
    """Queue flights of the answer of the job ``source``, as the document ``body`` says; return their job.

    Its id is ``new_id``, unless ``key`` was bound to another.
    Raises as `Service.submit` does, and ServiceError where there is no answer that could be flown.
    """
    answered = service.answers.answer(source)
    request = parse_document(body)
    spec = check_flights(request, answered["resolved"]["document"])
    if not trajectory_of(answered).finite:
        raise not_finite()
    record = _record(spec, source, principal, new_id)
    job_id = service.once(
        key,
        # The same words about another answer are another request; what is drawn is drawn in their order.
        lambda: canonical_json([source, request], ordered=True),
        record.id,
        lambda job_id: service.queue_job(replace(record, id=job_id), body),
        service.store.exists,
    )
    return record if job_id == record.id else service.store.get(job_id)


def _record(spec: FlightsSpec, source: str, principal: Principal, new_id: str) -> JobRecord:
    now = time.time()
    return JobRecord(
        id=new_id,
        status=JobStatus.QUEUED,
        method=METHOD,
        max_seconds=spec.max_seconds,
        created_at=now,
        estimate=min(_SECONDS_PER_RUN * spec.runs, spec.max_seconds),
        name=spec.name or None,
        tags=tuple(spec.tags),
        flights_of=source,
        project=principal.project,
        submitted_by=principal.key,
    )
