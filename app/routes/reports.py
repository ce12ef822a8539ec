"""The report of a job: one page to be printed, for the design review."""

from __future__ import annotations

import json

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from app.openapi import refusals
from app.report import POLICY, write_report
from app.schemas import JobView
from app.service import Shared

router = APIRouter(prefix="/v1/jobs/{job_id}", tags=["results"])


@router.get("/report.html", response_class=HTMLResponse, responses=refusals(404, 409, 410, 503))
def report(service: Shared, job_id: str) -> HTMLResponse:
    """Write the report of a final job, also of one that has no result: no script, nothing loaded."""
    record, text = service.answers.solved(job_id)
    page = write_report(
        json.loads(service.store.document(job_id)),
        None if text is None else json.loads(text),
        JobView.of(record).model_dump(mode="json"),
    )
    return HTMLResponse(page, headers={"Content-Security-Policy": POLICY})
