"""The command of a result: the table that an on-board computer plays, at any period."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response

from app.errors import ServiceError, wrong_parameter
from app.negotiation import chosen_type
from app.openapi import refusals
from app.service import Shared
from solvers.output.aftermath import TooManyRowsError, commanded
from solvers.output.export import command_csv, command_mat
from solvers.phases.trajectory import trajectory_of
from solvers.spec import CommandSpec, check_document

router = APIRouter(prefix="/v1/jobs/{job_id}", tags=["results"])

_MEDIA = {"json": "application/json", "csv": "text/csv", "mat": "application/x-matlab-data"}
_EXPORTS: Mapping[str, Callable[[Mapping[str, Any]], str | bytes]] = {"csv": command_csv, "mat": command_mat}


@router.get(
    "/command",
    responses={
        200: {"content": {media: {} for media in _MEDIA.values()}},
        **refusals(404, 406, 409, 410, 422, 503),
    },
)
def command(
    request: Request,
    service: Shared,
    job_id: str,
    period: Annotated[
        float | None,
        Query(gt=0, allow_inf_nan=False, description="Default: that of the document's output.command."),
    ] = None,
    rule: Annotated[Literal["average", "sample"] | None, Query(description="Likewise.")] = None,
    format: Annotated[
        str | None, Query(description="Instead of Accept.", json_schema_extra={"enum": [*_MEDIA, None]})
    ] = None,
) -> Response:
    """Return the control as values that are held for one period each, and the flight of the table.

    CSV has a row for each period; MAT has the structure ``command`` for Simulink's From Workspace block.
    """
    kind = chosen_type(request, _MEDIA)
    stored = service.answers.answer(job_id)
    if stored["method"]["name"] == "piecewise":
        raise ServiceError("no-result", "A mission in segments has no command table.")
    spec = check_document(stored["resolved"]["document"])
    given = spec.output.command
    if given is None and period is None:
        raise wrong_parameter("period", "is needed, for the document has no output.command")
    changes = {"period": period, "rule": rule}
    wanted = (given or CommandSpec.model_construct()).changed(
        **{name: value for name, value in changes.items() if value is not None}
    )
    try:
        found = commanded(spec.problem, wanted, [trajectory_of(stored)])
        text = json.dumps({"job_id": job_id, **found}, allow_nan=False, separators=(",", ":"))
    except TooManyRowsError as error:
        raise wrong_parameter("period", str(error)) from error
    except (TypeError, ValueError) as error:  # null for the numbers of an iterate that diverged
        detail = "The last iterate is not finite, so that there is no command."
        raise ServiceError("no-result", detail) from error
    headers = {"Vary": "Accept"}
    if kind != "json":
        headers["Content-Disposition"] = f'attachment; filename="{job_id}-command.{kind}"'
        return Response(_EXPORTS[kind](found), media_type=_MEDIA[kind], headers=headers)
    return Response(text, media_type=_MEDIA[kind], headers=headers)
