"""Results: whole, as files of other programs, resampled, drawn."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Query, Request, Response
from numpy.typing import NDArray

from app.answers import not_finite, trajectory_of
from app.errors import ServiceError, wrong_parameter
from app.negotiation import chosen_type, encodings
from app.openapi import refusals
from app.report import POLICY
from app.schemas import JobView
from app.service import Service, Shared
from solvers.output.bundle import pack
from solvers.output.export import to_csv, to_mat, to_npz
from solvers.output.plot import render
from solvers.output.sampling import resample
from solvers.phases.trajectory import AnyTrajectory
from worker.records import JobEvent, timestamp

router = APIRouter(prefix="/v1/jobs/{job_id}", tags=["results"])

MAX_SAMPLES = 20_001
DEFAULT_SAMPLES = 201

_MEDIA = {
    "json": "application/json",
    "csv": "text/csv",
    "npz": "application/x-npz",
    "mat": "application/x-matlab-data",
}
_EXPORTS: Mapping[str, Callable[[Mapping[str, Any]], str | bytes]] = {
    "csv": to_csv,
    "npz": to_npz,
    "mat": to_mat,
}

_OF_TRAJECTORIES = frozenset({"npz", "mat"})
"""Formats that hold a trajectory only."""


@router.get(
    "/result",
    responses={
        200: {"content": {media: {} for media in _MEDIA.values()}},
        **refusals(404, 406, 409, 410, 503),
    },
)
def result(
    request: Request,
    service: Shared,
    job_id: str,
    format: Annotated[
        str | None, Query(description="Instead of Accept.", json_schema_extra={"enum": [*_MEDIA, None]})
    ] = None,
) -> Response:
    """Return the result of a final job; CSV, NPZ and MAT hold the sampled trajectory.

    Of flights CSV has a row for each, and NPZ and MAT are not made.
    """
    kind = chosen_type(request, _MEDIA)
    packed, text = service.answers.result_twice(job_id)
    if kind in _OF_TRAJECTORIES and service.store.get(job_id).flights_of is not None:
        raise ServiceError("not-acceptable", "Flights are available as application/json and text/csv.")
    headers = {"Vary": "Accept, Accept-Encoding"}
    if kind == "json" and "deflate" in encodings(request):
        # That is the format of zlib (RFC 9110, section 8.4.1.2), in which results are kept.
        return Response(packed, media_type=_MEDIA[kind], headers={**headers, "Content-Encoding": "deflate"})
    if kind == "json":
        return Response(text, media_type=_MEDIA[kind], headers=headers)
    headers["Content-Disposition"] = f'attachment; filename="{job_id}.{kind}"'
    return Response(_EXPORTS[kind](json.loads(text)), media_type=_MEDIA[kind], headers=headers)


@router.get("/trajectory", responses=refusals(404, 409, 410, 422, 503))
def trajectory(
    service: Shared,
    job_id: str,
    samples: Annotated[int | None, Query(ge=2, le=MAX_SAMPLES)] = None,
    t: Annotated[str | None, Query(description="Times, separated by commas, in the problem's unit.")] = None,
    dt: Annotated[float | None, Query(gt=0, allow_inf_nan=False, description="Step from t0 on.")] = None,
    derivatives: bool = False,
) -> Response:
    """Resample the trajectory from its coefficients: at ``samples`` times, at times ``t``, or by ``dt``."""
    stored = service.answers.answer(job_id)
    curves = trajectory_of(stored)
    times = _times(curves, samples, t, dt)
    sampled = resample(stored, curves, times, derivatives=derivatives)
    try:
        text = json.dumps({"job_id": job_id, **sampled}, allow_nan=False, separators=(",", ":"))
    except ValueError as error:
        raise not_finite() from error
    return Response(text, media_type="application/json")


@router.get(
    "/plot.svg",
    responses={200: {"content": {"image/svg+xml": {}}}, **refusals(404, 409, 410, 503)},
)
def plot_svg(service: Shared, job_id: str) -> Response:
    """Draw states and controls over time, with the switching times marked."""
    return _plot(service, job_id, "svg", "image/svg+xml")


@router.get(
    "/plot.png",
    responses={200: {"content": {"image/png": {}}}, **refusals(404, 409, 410, 503)},
)
def plot_png(service: Shared, job_id: str) -> Response:
    """Draw the same picture as PNG."""
    return _plot(service, job_id, "png", "image/png")


@router.get(
    "/bundle.zip",
    response_class=Response,
    responses={200: {"content": {"application/zip": {}}}, **refusals(404, 409, 410, 503)},
)
def bundle(service: Shared, job_id: str) -> Response:
    """Return everything to repeat the job elsewhere, for ``ondelette replay``; what failed has no result.

    Flights come with the result of the job whose answer they flew, as long as that is kept.
    """
    record, text = service.answers.ended(job_id)
    flown = None if record.flights_of is None else service.store.kept_result(record.flights_of)
    packed = pack(
        service.store.document(job_id),
        JobView.of(record).model_dump(mode="json"),
        None if text is None else json.loads(text),
        [_log_line(event) for event in service.store.events(job_id)],
        None if flown is None else json.loads(flown),
    )
    headers = {"Content-Disposition": f'attachment; filename="{job_id}.zip"'}
    return Response(packed, media_type="application/zip", headers=headers)


def _log_line(event: JobEvent) -> str:
    moment = timestamp(int(event.number.partition("-")[0]) / 1000)
    return f"{moment} {event.kind} {json.dumps(event.data)}"


def _plot(service: Service, job_id: str, kind: Literal["svg", "png"], media: str) -> Response:
    answer = service.answers.answer(job_id)
    title = service.store.get(job_id).name or ""
    picture = render(answer, kind, title)
    return Response(picture, media_type=media, headers={"Content-Security-Policy": POLICY})


def _times(
    curves: AnyTrajectory, samples: int | None, times: str | None, step: float | None
) -> NDArray[np.float64]:
    if sum(choice is not None for choice in (samples, times, step)) > 1:
        raise wrong_parameter("samples", "give only one of samples, t and dt")
    if times is not None:
        return _listed(times, curves)
    t0, tf = curves.t0, curves.tf
    if step is not None:
        # A last step that ends at tf but for rounding counts.
        count = (tf - t0) / step * (1 + 1e-12) + 1
        if not count < MAX_SAMPLES + 1:
            raise wrong_parameter("dt", f"gives more than {MAX_SAMPLES:,} samples, the limit")
        grid: NDArray[np.float64] = np.minimum(t0 + step * np.arange(math.floor(count)), tf)
        return grid
    return np.linspace(t0, tf, samples or DEFAULT_SAMPLES)


def _listed(times: str, curves: AnyTrajectory) -> NDArray[np.float64]:
    words = times.split(",")
    if len(words) > MAX_SAMPLES:
        raise wrong_parameter("t", f"has more than {MAX_SAMPLES:,} times, the limit")
    try:
        listed = np.array([float(word) for word in words])
    except ValueError:
        raise wrong_parameter("t", "must be numbers, separated by commas") from None
    if not curves.covers(listed):
        raise wrong_parameter("t", f"has times outside the trajectory, [{curves.t0!r}, {curves.tf!r}]")
    return listed
