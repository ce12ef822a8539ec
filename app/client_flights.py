"""What a client asks of the service about flights; see `app.client_steps`."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from typing import Any

from app.client_answers import Job
from app.client_calls import awaited, path_of
from app.client_steps import Call, Steps, ask, read_json


def submit_flights(
    job_id: str, flights: Mapping[str, Any], *, idempotency_key: str | None = None
) -> Call[Job]:
    """Queue flights of the answer of a job, and return the job that they are."""
    key = idempotency_key or uuid.uuid4().hex
    return Call(
        "POST", path_of(job_id, "/flights"), read_json, json=flights, headers={"Idempotency-Key": key}
    )


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
    return (yield from awaited(queued["id"], _read, timeout, on_progress, every))


def _read(job_id: str) -> Call[dict[str, Any]]:
    return Call("GET", path_of(job_id, "/result"), read_json)
