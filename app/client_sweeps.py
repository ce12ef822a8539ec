"""What a client asks of the service about sweeps; see `app.client_steps`."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Mapping
from typing import Any, Literal
from urllib.parse import quote

from app.client_answers import SweepTimeout
from app.client_calls import FINAL, LONG_POLL, Document, plain
from app.client_steps import Call, Steps, ask, read_bytes, read_json

Sweep = dict[str, Any]
Grid = Mapping[str, Any]


def submit_sweep(
    document: Document, grid: Grid, *, zip: bool = False, idempotency_key: str | None = None
) -> Call[Sweep]:
    """Queue a job for every point of a sweep and return the sweep.

    ``grid``: JSON pointers into the document with a list of values, or with ``from``, ``to``, ``count`` and
    ``scale``. ``zip`` takes them side by side instead of their product.
    """
    key = idempotency_key or uuid.uuid4().hex
    body = {"document": plain(document), "grid": grid, "zip": zip}
    # Thousands of documents are checked before the answer comes.
    return Call("POST", "/v1/sweeps", read_json, json=body, headers={"Idempotency-Key": key}, seconds=120)


def read_sweep(sweep_id: str, *, table: bool = True) -> Call[Sweep]:
    """Read how a sweep stands, with the table of its points."""
    return Call("GET", _of(sweep_id), read_json, params={"table": int(table)})


def wait_for_sweep(
    sweep_id: str,
    *,
    timeout: float | None = None,
    on_progress: Callable[[Sweep], object] | None = None,
    every: float = 1.0,
) -> Steps[Sweep]:
    """Return the sweep, with its table, when all its jobs have ended.

    ``timeout`` in seconds raises `SweepTimeout` (the jobs go on); ``on_progress`` is shown the sweep without
    its table every ``every`` seconds.
    """
    deadline = None if timeout is None else time.monotonic() + timeout
    poll = LONG_POLL if on_progress is None else every
    while True:
        left = poll if deadline is None else max(min(poll, deadline - time.monotonic()), 0.0)
        params = {"wait": round(left, 3), "table": 0}
        seen: Sweep = yield from ask(Call("GET", _of(sweep_id), read_json, params=params, seconds=left))
        if on_progress is not None:
            on_progress(seen)
        if seen["status"] in FINAL:
            return (yield from ask(read_sweep(sweep_id)))
        if deadline is not None and time.monotonic() >= deadline:
            raise SweepTimeout(seen)


def sweep(
    document: Document,
    grid: Grid,
    *,
    zip: bool = False,
    timeout: float | None = None,
    on_progress: Callable[[Sweep], object] | None = None,
    every: float = 1.0,
) -> Steps[Sweep]:
    """Solve a document at all points of a grid; returns the sweep with its table (see `submit_sweep`)."""
    queued = yield from ask(submit_sweep(document, grid, zip=zip))
    return (yield from wait_for_sweep(queued["id"], timeout=timeout, on_progress=on_progress, every=every))


def export_sweep(
    sweep_id: str, kind: Literal["csv", "npz"], *, nodes: bool = False, trajectory: bool = False
) -> Call[bytes]:
    """Read all points in columns; NPZ with the ``nodes`` and the ``trajectory`` of each if wanted."""
    params: dict[str, str | int | float] = {"format": kind}
    params |= {name: 1 for name, wanted in (("nodes", nodes), ("trajectory", trajectory)) if wanted}
    return Call("GET", _of(sweep_id, "/result"), read_bytes, params=params, seconds=120)


def cancel_sweep(sweep_id: str) -> Call[Sweep]:
    """Cancel all jobs of a sweep that have not ended."""
    return Call("POST", _of(sweep_id, "/cancel"), read_json)


def _of(sweep_id: str, part: str = "") -> str:
    return f"/v1/sweeps/{quote(sweep_id, safe='')}{part}"
