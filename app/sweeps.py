"""How a sweep becomes jobs, and how it is shown."""

from __future__ import annotations

import json
import logging
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from pydantic import BaseModel, Field

from app.auth import Principal
from app.schemas import VerificationView
from app.service import Service, new_record
from solvers.sizes import problem_size
from solvers.spec import canonical_json, parse_document
from solvers.spec.sweep import SweepPlan, check_sweep
from worker.errors import QueueUnavailable
from worker.records import JobStatus, SweepPlace, new_job_id, timestamp
from worker.sweeps import SweepRecord, TableRow

logger = logging.getLogger(__name__)

SweepStatus = Literal["queued", "running", "succeeded", "failed", "cancelled"]


class SweepRowView(BaseModel):
    """A point of a sweep: its values by pointer, its job, and what came of it."""

    index: int
    point: dict[str, Any]
    job: str = Field(description="Id of the job; its links are those of any job.")
    href: str
    status: str = Field(description="Status of the job; gone where it was erased before it was noted.")
    error: str | None
    objective: float | None
    final_time: float | None
    verification: VerificationView | None
    iterations: int | None
    seconds: float | None


class SweepLinks(BaseModel):
    """Where the parts of a sweep are."""

    self: str
    cancel: str
    csv: str
    npz: str


class SweepView(BaseModel):
    """A sweep: how many of its jobs stand where, and the table of its points."""

    id: str
    name: str | None
    status: SweepStatus = Field(
        description="succeeded if every point is, else failed or cancelled by what most of the others are."
    )
    pointers: list[str]
    zip: bool
    points: int
    counts: dict[str, int]
    created_at: str
    finished_at: str | None
    table: list[SweepRowView] | None = Field(description="Null where it was not asked for (table=0).")
    links: SweepLinks


def submit_sweep(service: Service, body: bytes, key: str | None, principal: Principal) -> str:
    """Check a sweep and all documents of its points, then queue a job for each; return the sweep's id.

    ``key`` is the client's Idempotency-Key. Raises as `Service.submit` does. A job whose message
    the broker does not take is published by the reconciler.
    """
    request = parse_document(body)
    plan = check_sweep(request)
    for spec in {point.spec.warm_start: point.spec for point in plan.points}.values():
        service.find_start(spec, principal)
    for spec in {point.spec.webhook and point.spec.webhook.url: point.spec for point in plan.points}.values():
        service.check_webhook(spec)
    sweep_id = new_job_id()
    return service.once(
        key,
        # The order of the grid is that of the table.
        lambda: canonical_json(request, ordered=True),
        sweep_id,
        lambda bound: _queue(service, bound, plan, principal),
        service.sweeps.exists,
    )


def _queue(service: Service, sweep_id: str, plan: SweepPlan, principal: Principal) -> None:
    service.admit(principal.project, len(plan.points))
    # Of a point's size only the time is asked; what is solved in the same way takes about as long.
    specs = {repr(point.spec.method): point.spec for point in plan.points}
    sizes = {method: problem_size(spec) for method, spec in specs.items()}
    jobs = [
        (
            new_record(
                new_job_id(),
                point.spec,
                sizes[repr(point.spec.method)],
                principal,
                SweepPlace(sweep_id, index, point.place),
            ),
            json.dumps(point.document).encode(),
        )
        for index, point in enumerate(plan.points)
    ]
    name = plan.points[0].spec.name or None
    record = SweepRecord(
        sweep_id, plan.pointers, plan.zipped, len(jobs), time.time(), name, project=principal.project
    )
    service.sweeps.add(record, jobs, [point.values for point in plan.points])
    try:
        service.queue.enqueue(*(jobs[index][0] for index in plan.path))
    except QueueUnavailable as error:
        logger.warning("%s; jobs of sweep %s wait for the reconciler", error, sweep_id)


def sweep_view(record: SweepRecord, rows: Sequence[TableRow], *, table: bool) -> SweepView:
    """Return the view of a sweep; without ``table`` it is short."""
    counts = Counter(row.status for row in rows)
    here = f"/v1/sweeps/{record.id}"
    return SweepView(
        id=record.id,
        name=record.name,
        status=_status(counts),
        pointers=list(record.pointers),
        zip=record.zipped,
        points=record.count,
        counts={status.value: 0 for status in JobStatus} | counts,
        created_at=timestamp(record.created_at),
        finished_at=None if record.finished_at is None else timestamp(record.finished_at),
        table=[_row(record, index, row) for index, row in enumerate(rows)] if table else None,
        links=SweepLinks(
            self=here,
            cancel=f"{here}/cancel",
            csv=f"{here}/result?format=csv",
            npz=f"{here}/result?format=npz",
        ),
    )


def is_final(rows: Sequence[TableRow]) -> bool:
    """Tell whether every point has ended."""
    return all(row.ending is not None for row in rows)


def _status(counts: Mapping[str, int]) -> SweepStatus:
    if counts.get("running", 0) or (counts.get("queued", 0) and len(counts) > 1):
        return "running"
    if counts.get("queued", 0):
        return "queued"
    failed, cancelled = counts.get("failed", 0) + counts.get("gone", 0), counts.get("cancelled", 0)
    if not failed and not cancelled:
        return "succeeded"
    return "failed" if failed >= cancelled else "cancelled"


def _row(record: SweepRecord, index: int, row: TableRow) -> SweepRowView:
    ending = row.ending or {}
    verification = ending.get("verification")
    return SweepRowView(
        index=index,
        point=dict(zip(record.pointers, row.values, strict=True)),
        job=row.job_id,
        href=f"/v1/jobs/{row.job_id}",
        status=row.status,
        error=ending.get("error"),
        objective=ending.get("objective"),
        final_time=ending.get("final_time"),
        verification=None if verification is None else VerificationView(**verification),
        iterations=ending.get("iterations"),
        seconds=ending.get("seconds"),
    )
