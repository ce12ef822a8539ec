"""What happens to a job, told as it happens: server-sent events (WHATWG HTML, section 9.2)."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from typing import Any

from fastapi import APIRouter, Depends, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse

from app.auth import principal_of
from app.errors import wrong_parameter
from app.openapi import refusals
from app.service import Shared
from worker.records import FIRST, JobEvent, is_event_number, timestamp

router = APIRouter(prefix="/v1/jobs/{job_id}", tags=["jobs"])

MEDIA = "text/event-stream"

# How long a browser waits before it connects again, in milliseconds.
_PREAMBLE = "retry: 2000\n\n"
_HEARTBEAT = ": still here\n\n"


async def _seat(request: Request, service: Shared) -> AsyncIterator[None]:
    with service.seats.taken(principal_of(request)):
        yield


# The seat is held until the last event is sent: what follows a dependency's yield comes after the answer.
@router.get(
    "/events",
    dependencies=[Depends(_seat)],
    response_class=Response,
    responses={200: {"content": {MEDIA: {}}}, 204: {}, **refusals(404, 410, 422, 503)},
)
async def events(request: Request, service: Shared, job_id: str) -> Response:
    """Tell what happens to a job, from its beginning or from behind ``Last-Event-ID`` on, until it ends.

    Events: ``status``, ``progress``, and ``result`` when there is one to read. 204 says that nothing follows.
    """
    after = request.headers.get("last-event-id")
    if after is not None and not is_event_number(after):
        raise wrong_parameter("Last-Event-ID", "is not the id of an event that this service sent")
    ended = (await run_in_threadpool(service.store.get, job_id)).status.final
    if after is not None and ended and not await run_in_threadpool(service.store.events, job_id, after):
        # A browser that is told so does not come back.
        return Response(status_code=204)
    # A proxy must pass on every event at once.
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    told = service.watch.events(job_id, after or FIRST)
    return StreamingResponse(_written(job_id, told), media_type=MEDIA, headers=headers)


async def _written(job_id: str, told: AsyncIterator[JobEvent | None]) -> AsyncIterator[str]:
    yield _PREAMBLE
    async for event in told:
        if event is None:
            yield _HEARTBEAT
        else:
            data = json.dumps(_data(job_id, event), separators=(",", ":"))
            yield f"id: {event.number}\nevent: {event.kind}\ndata: {data}\n\n"


def _data(job_id: str, event: JobEvent) -> dict[str, Any]:
    if event.kind == "status":
        return {"job_id": job_id, **event.data, "at": timestamp(event.data["at"])}
    if event.kind == "result":
        return {"job_id": job_id, "href": f"/v1/jobs/{job_id}/result"}
    return dict(event.data)
