"""What is on board: library models, methods, and cases with their reference answers."""

from __future__ import annotations

import json

from fastapi import APIRouter, Response

from app.errors import ServiceError
from app.openapi import refusals
from app.schemas import CaseList, CaseView, MethodList, ModelList
from solvers import catalogue

router = APIRouter(prefix="/v1", tags=["catalogue"])


@router.get("/models")
def models() -> ModelList:
    """List the library models with their states, controls and parameters."""
    return ModelList(models=catalogue.models())


@router.get("/methods")
def methods() -> MethodList:
    """List the methods with their defaults and JSON Schemas."""
    return MethodList(methods=catalogue.methods())


@router.get("/cases")
def cases() -> CaseList:
    """List the cases on board."""
    views = []
    for name in catalogue.case_names():
        document = catalogue.load_case(name)
        views.append(
            CaseView(
                name=name,
                title=document.get("name", name),
                method=document.get("method", {}).get("name", "auto"),
                reference=document.get("reference"),
                href=f"/v1/cases/{name}",
            )
        )
    return CaseList(cases=views)


@router.get("/cases/{name}", responses=refusals(404))
def case(name: str) -> Response:
    """Return a case: a complete job document, ready to POST."""
    if name not in catalogue.case_names():
        raise ServiceError("not-found", f"The cases are {', '.join(catalogue.case_names())}.")
    return Response(json.dumps(catalogue.load_case(name)), media_type="application/json")
