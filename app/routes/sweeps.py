"""Sweeps: one document at many points, each a job, and all of them in one table."""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from app.auth import Principal, principal_of
from app.errors import wrong_parameter
from app.negotiation import LONGEST_WAIT, chosen_type, preferred_wait
from app.openapi import SWEEP_BODY, refusals
from app.routes.jobs import Body, Key
from app.service import Service, Shared
from app.sweeps import SweepView, is_final, submit_sweep, sweep_view
from solvers.output.sweep_export import FIGURES, stacked, sweep_csv, sweep_npz
from worker.sweeps import SweepRecord, TableRow

router = APIRouter(prefix="/v1/sweeps", tags=["sweeps"])

MAX_NUMBERS = 20_000_000
"""Most numbers of the histories in one file."""

_LONGEST_RETRY = 10
_MEDIA = {"csv": "text/csv", "npz": "application/x-npz"}


@router.post(
    "",
    status_code=202,
    response_model=SweepView,
    responses=refusals(409, 413, 415, 422, 503),
    openapi_extra=SWEEP_BODY,
)
async def submit(request: Request, service: Shared, body: Body, key: Key) -> Response:
    """Queue a job for every point of a sweep. ``Prefer: wait=N`` delays the answer until all have ended."""
    principal = principal_of(request)
    sweep_id = await run_in_threadpool(submit_sweep, service, body, key, principal)
    # As of a job: where there is no seat to wait at, it is answered for at once.
    wait = preferred_wait(request) if service.seats.refusal(principal) is None else None
    response = _answer(*await _seen(service, principal, sweep_id, wait or 0.0), 202, table=True)
    response.headers["Location"] = response.headers["Content-Location"] = f"/v1/sweeps/{sweep_id}"
    if wait is not None:
        response.headers["Preference-Applied"] = f"wait={wait:g}"
    return response


@router.get("/{sweep_id}", response_model=SweepView, responses=refusals(404, 422, 503))
async def sweep(
    request: Request,
    service: Shared,
    sweep_id: str,
    wait: Annotated[float, Query(ge=0, allow_inf_nan=False)] = 0.0,
    table: Annotated[bool, Query(description="Whether to list the points.")] = True,
) -> Response:
    """Tell how a sweep stands; ``wait`` delays the answer until all jobs have ended, at most 60 s."""
    return _answer(*await _seen(service, principal_of(request), sweep_id, wait), 200, table=table)


@router.post("/{sweep_id}/cancel", status_code=202, response_model=SweepView, responses=refusals(404, 503))
def cancel(service: Shared, sweep_id: str) -> Response:
    """Cancel every job of a sweep that has not ended."""
    service.sweeps.cancel(sweep_id)
    return _answer(*_look(service, sweep_id), 202, table=True)


@router.get(
    "/{sweep_id}/result",
    responses={200: {"content": {media: {} for media in _MEDIA.values()}}, **refusals(404, 406, 422, 503)},
)
def result(
    request: Request,
    service: Shared,
    sweep_id: str,
    format: Annotated[
        str | None, Query(description="Instead of Accept.", json_schema_extra={"enum": [*_MEDIA, None]})
    ] = None,
    nodes: Annotated[bool, Query(description="NPZ: add the nodes of each answer.")] = False,
    trajectory: Annotated[bool, Query(description="NPZ: add the samples of each answer.")] = False,
) -> Response:
    """Return all points in columns, with what is known of each by now."""
    kind = chosen_type(request, _MEDIA)
    record, rows = _look(service, sweep_id)
    columns = [_columns(row) for row in rows]
    headers = {"Vary": "Accept", "Content-Disposition": f'attachment; filename="{sweep_id}.{kind}"'}
    if kind == "csv":
        return Response(sweep_csv(record.pointers, columns), media_type=_MEDIA[kind], headers=headers)
    histories: dict[str, Any] = {}
    for part, wanted in (("nodes", nodes), ("trajectory", trajectory)):
        if wanted:
            histories |= _histories(service, rows, part)
    return Response(sweep_npz(record.pointers, columns, histories), media_type=_MEDIA[kind], headers=headers)


async def _seen(
    service: Service, principal: Principal, sweep_id: str, wait: float
) -> tuple[SweepRecord, list[TableRow]]:
    with service.seats.taken(principal) if wait else contextlib.nullcontext():
        return await service.watch.until(
            sweep_id,
            lambda: _look(service, sweep_id),
            lambda seen: is_final(seen[1]),
            min(wait, LONGEST_WAIT),
        )


def _look(service: Service, sweep_id: str) -> tuple[SweepRecord, list[TableRow]]:
    # In this order: the last ending that is noted writes when the sweep was finished.
    rows = service.sweeps.table(sweep_id)
    return service.sweeps.get(sweep_id), rows


def _answer(record: SweepRecord, rows: list[TableRow], status: int, *, table: bool) -> Response:
    view = sweep_view(record, rows, table=table)
    headers = {} if is_final(rows) else {"Retry-After": str(_retry_after(record, rows))}
    return Response(view.model_dump_json(), status, headers, "application/json")


def _retry_after(record: SweepRecord, rows: list[TableRow]) -> int:
    """Seconds after which it is worth asking again, by how fast points have ended until now."""
    ended = sum(row.ending is not None for row in rows)
    left = (time.time() - record.created_at) / ended * (len(rows) - ended) if ended else 0.0
    return max(1, min(_LONGEST_RETRY, math.ceil(left)))


def _columns(row: TableRow) -> dict[str, Any]:
    ending: Mapping[str, Any] = row.ending or {}
    known = {**ending, **(ending.get("verification") or {})}
    figures = {name: known.get(name) for name in (*FIGURES, "success")}
    return {"values": row.values, "job": row.job_id, "status": row.status, **figures}


def _histories(service: Service, rows: list[TableRow], part: str) -> dict[str, Any]:
    """The ``nodes`` or the ``trajectory`` of every point that has a result, as ``<part>.<name>``."""
    histories: list[dict[str, Any] | None] = []
    numbers = 0
    for row in rows:
        # Whoever has no figures has no result: of thousands that were cancelled none is asked for.
        text = service.store.kept_result(row.job_id) if row.ending and "success" in row.ending else None
        if text is None:
            histories.append(None)
            continue
        stored = json.loads(text)[part]
        named = {"t": stored["t"]}
        for group, suffix in (("states", ""), ("controls", ""), ("outputs", ""), ("costates", "_costate")):
            named |= {name + suffix: values for name, values in stored.get(group, {}).items()}
        histories.append({f"{part}.{name}": values for name, values in named.items()})
        numbers += sum(map(len, named.values()))
        if numbers > MAX_NUMBERS:
            detail = f"these are more than {MAX_NUMBERS:,} numbers, the limit; ask for the jobs one by one"
            raise wrong_parameter(part, detail)
    return dict(stacked(histories))
