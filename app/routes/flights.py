"""Flights: the answer of a job flown many times, with what is uncertain drawn anew."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from app.auth import principal_of
from app.flights import submit_flights
from app.openapi import FLIGHTS_BODY, refusals
from app.routes.jobs import Body, Key, submitted
from app.schemas import JobView
from app.service import Shared

router = APIRouter(prefix="/v1/jobs/{job_id}", tags=["flights"])


@router.post(
    "/flights",
    status_code=202,
    response_model=JobView,
    responses=refusals(404, 409, 410, 413, 415, 422, 503),
    openapi_extra=FLIGHTS_BODY,
)
async def fly(request: Request, service: Shared, job_id: str, body: Body, key: Key) -> Response:
    """Queue flights of a job's answer as a job of their own. ``Prefer: wait=N`` waits for their end."""
    principal = principal_of(request)
    return await submitted(
        request, service, lambda new_id: submit_flights(service, job_id, body, key, principal, new_id)
    )
