"""What a client asks of the service about flights; see `app.client_steps`."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import quote

import httpx

from app.client_answers import Job, JobFailed, RequestRefused
from app.client_calls import wait
from app.client_steps import Call, Steps, ask, read_json


def submit_flights(
    job_id: str, flights: Mapping[str, Any], *, idempotency_key: str | None = None
) -> Call[Job]:
    """Queue flights of the answer of a job, and return the job that they are."""
    key = idempotency_key or uuid.uuid4().hex
    path = f"/v1/jobs/{quote(job_id, safe='')}/flights"
    return Call("POST", path, read_json, json=flights, headers={"Idempotency-Key": key})


def flights(
    job_id: str,
    flights: Mapping[str, Any],
    *,
    timeout: float | None = None,
    on_progress: Callable[[Job], object] | None = None,
    every: float = 1.0,
) -> Steps[dict[str, Any]]:
    """Fly the answer of a job many times, wait, and return what came of it.

    ``flights`` is the document: ``{"runs": 1000, "parameters": {"k": {"uniform": [90, 110]}}}``.
    The other arguments are those of ``wait``. Raises `JobFailed` when the flights were not all flown.
    """
    queued = yield from ask(submit_flights(job_id, flights))
    final = yield from wait(queued["id"], timeout=timeout, on_progress=on_progress, every=every)
    try:
        read: Call[dict[str, Any]] = Call("GET", final["links"]["result"], read_json)
        return (yield from ask(read))
    except RequestRefused as error:
        if error.status == httpx.codes.NOT_FOUND:
            raise JobFailed(final) from error
        raise
