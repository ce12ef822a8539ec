"""Jobs: submit, look, wait, list, cancel, erase."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Annotated
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from app.auth import principal_of
from app.direct_route import DirectRoute
from app.errors import wrong_parameter
from app.negotiation import LONGEST_WAIT, idempotency_key, json_body, matches_etag, preferred_wait
from app.openapi import DOCUMENT_BODY, refusals
from app.schemas import JobPage, JobView, SizeView
from app.service import Service, Shared, service_of
from worker.records import JobRecord, JobStatus, is_job_id, new_job_id

router = APIRouter(prefix="/v1", tags=["jobs"])

Body = Annotated[bytes, Depends(json_body)]
Key = Annotated[str | None, Depends(idempotency_key)]


async def submit(request: Request) -> Response:
    """Queue a job document. ``Prefer: wait=N`` delays the answer until the job is final, at most 60 s."""
    body, key = await json_body(request), await idempotency_key(request)
    service, principal = service_of(request), principal_of(request)
    return await submitted(request, service, lambda job_id: service.submit(body, key, principal, job_id))


router.add_api_route(
    "/jobs",
    submit,
    methods=["POST"],
    status_code=202,
    response_model=JobView,
    responses=refusals(409, 413, 415, 422, 503),
    openapi_extra=DOCUMENT_BODY,
    route_class_override=DirectRoute,
)


async def submitted(request: Request, service: Service, submit: Callable[[str], JobRecord]) -> Response:
    """Submit a job, and answer with it at once or, where the client prefers to wait, when it is final.

    ``submit`` is given an id for the job, and may find that there is one already.
    """
    wait, principal = preferred_wait(request), principal_of(request)
    job_id = new_job_id()
    # Where there is no seat to wait at, it is answered for at once, which the preference allows.
    if wait is None or service.seats.refusal(principal) is not None:

        def queued() -> tuple[JobRecord, Response]:
            record = submit(job_id)
            return record, _answer(service, record, 202)

        # One change of thread for all that asks the broker.
        record, response = await run_in_threadpool(queued)
    else:
        with service.seats.taken(principal), service.watch.ending(job_id) as ended:
            record = await run_in_threadpool(submit, job_id)
            if not record.status.final:
                fresh = record.id == job_id
                record = await service.watch.final(record.id, wait, ended if fresh else None)
        response = await _answered(service, record, 202)
        response.headers["Preference-Applied"] = f"wait={wait:g}"
    response.headers["Location"] = response.headers["Content-Location"] = f"/v1/jobs/{record.id}"
    return response


@router.post("/validate", responses=refusals(413, 415, 422, 503), openapi_extra=DOCUMENT_BODY)
def validate(request: Request, service: Shared, body: Body) -> SizeView:
    """Check a document and tell its size and an estimate of the solve time; nothing is queued."""
    spec, size = service.check(body, principal_of(request))
    return SizeView(
        method=spec.method.name,
        variables=size.variables,
        constraints=size.constraints,
        nodes=size.nodes,
        # An estimate: more digits would promise more.
        seconds=float(f"{size.seconds:.2g}"),
    )


@router.get("/jobs", response_model=JobPage, responses=refusals(422, 503))
def jobs(
    request: Request,
    service: Shared,
    status: JobStatus | None = None,
    method: str | None = None,
    tag: str | None = None,
    name: str | None = None,
    limit: Annotated[int, Query(ge=1, le=100)] = 20,
    cursor: str | None = None,
) -> Response:
    """List jobs, newest first. A page may hold fewer jobs than ``limit`` and still have a next one."""

    def wanted(record: JobRecord) -> bool:
        return (
            (status is None or record.status is status)
            and (method is None or record.method == method)
            and (tag is None or tag in record.tags)
            and (name is None or record.name == name)
        )

    records, last = service.store.page(
        limit, None if cursor is None else _id_of(cursor), wanted, principal_of(request).only
    )
    following = None if last is None else _cursor_of(last)
    page = JobPage(jobs=[JobView.of(record) for record in records], next_cursor=following)
    response = _json(page.model_dump_json())
    if following is not None:
        query = urlencode({**request.query_params, "cursor": following})
        response.headers["Link"] = f'</v1/jobs?{query}>; rel="next"'
    return response


@router.get("/jobs/{job_id}", response_model=JobView, responses={304: {}, **refusals(404, 410, 422, 503)})
async def job(
    request: Request,
    service: Shared,
    job_id: str,
    wait: Annotated[float, Query(ge=0, allow_inf_nan=False)] = 0.0,
) -> Response:
    """Tell how a job stands; ``wait`` delays the answer until the job is final, at most 60 s."""
    if wait:
        with service.seats.taken(principal_of(request)):
            record = await service.watch.final(job_id, min(wait, LONGEST_WAIT))
    else:
        record = await run_in_threadpool(service.store.get, job_id)
    if matches_etag(request, etag := _etag(record)):
        return Response(status_code=304, headers={"ETag": etag, "Cache-Control": "private, no-cache"})
    return await _answered(service, record, 200)


@router.post(
    "/jobs/{job_id}/cancel", status_code=202, response_model=JobView, responses=refusals(404, 410, 503)
)
def cancel(service: Shared, job_id: str) -> Response:
    """Cancel a job: a queued one never starts, a running one stops soon, an ended one stays as it is."""
    return _answer(service, service.store.cancel(job_id), 202)


@router.post("/jobs/{job_id}/pin", response_model=JobView, responses=refusals(404, 410, 503))
def pin(service: Shared, job_id: str) -> Response:
    """Keep a job until it is erased or unpinned, beyond the time for which ended jobs are kept."""
    return _answer(service, service.store.pin(job_id, pinned=True), 200)


@router.delete("/jobs/{job_id}/pin", response_model=JobView, responses=refusals(404, 410, 503))
def unpin(service: Shared, job_id: str) -> Response:
    """Keep an ended job only for its time again, which starts anew."""
    return _answer(service, service.store.pin(job_id, pinned=False), 200)


@router.delete("/jobs/{job_id}", status_code=204, responses=refusals(404, 409, 410, 503))
def erase(service: Shared, job_id: str) -> Response:
    """Erase a finished job with its document and result."""
    service.store.erase(job_id)
    return Response(status_code=204)


@router.get("/jobs/{job_id}/spec", responses=refusals(404, 410, 503))
def spec(service: Shared, job_id: str) -> Response:
    """Return the document as it was submitted."""
    return _json(service.store.document(job_id))


async def _answered(service: Service, record: JobRecord, status: int) -> Response:
    # Only for an active job is the broker asked (for Retry-After), and that is not to hold up the event loop.
    if record.status.final:
        return _answer(service, record, status)
    return await run_in_threadpool(_answer, service, record, status)


def _answer(service: Service, record: JobRecord, status: int) -> Response:
    response = _json(JobView.of(record).model_dump_json(), status)
    response.headers["ETag"] = _etag(record)
    response.headers["Cache-Control"] = "private, no-cache"
    if not record.status.final:
        response.headers["Retry-After"] = str(service.line.retry_after(record))
    elif status == 202:
        response.headers["Retry-After"] = "0"
    return response


def _json(text: str | bytes, status: int = 200) -> Response:
    return Response(text, status, media_type="application/json")


def _etag(record: JobRecord) -> str:
    return f'"{record.version}"'


def _cursor_of(job_id: str) -> str:
    return base64.urlsafe_b64encode(job_id.encode()).decode().rstrip("=")


def _id_of(cursor: str) -> str:
    try:
        job_id = base64.b64decode(cursor + "=" * (-len(cursor) % 4), b"-_", validate=True).decode()
    except ValueError:
        job_id = ""
    if not is_job_id(job_id):
        raise wrong_parameter("cursor", "is not one that this service gave; start without it")
    return job_id
