"""The report of a job as one HTML file: no script, no request to anybody, every text escaped."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from app.report.answer_tables import answer_tables
from app.report.cells import figure
from app.report.equations import Block, model_blocks, problem_blocks
from app.report.problem_tables import problem_tables
from app.report.review_tables import provenance_table, review_tables, verification_tables
from solvers.output.plot import render_parts, units_of, with_unit
from solvers.spec import JobSpec, PiecewiseMethod, check_document

if TYPE_CHECKING:
    from jinja2 import Template

POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'self'"
"""The content security policy of pages with pictures, which style themselves inline: nothing else may be."""
# A longer document is left to the service and to files.
_LONGEST_DOCUMENT = 20_000
_REFERENCE = re.compile(r'(\bid="|href="#|url\(#)')


def write_report(
    document: Mapping[str, Any], result: Mapping[str, Any] | None, job: Mapping[str, Any] | None = None
) -> str:
    """The report on a document, its result (None where there is none) and its job (None without a service).

    Raises DocumentError if this version does not accept the document.
    """
    spec = check_document(dict(document))
    units = dict(spec.problem.units) if result is None else units_of(result)
    text = json.dumps(document, indent=2, ensure_ascii=False)
    return _template().render(
        title=spec.name or "Optimal-control problem",
        spec=spec,
        job=job,
        result=result,
        verdict=_verdict(result, job),
        summary=list(_summary(spec, result, job, units)),
        blocks=list(_blocks(spec)),
        problem_tables=list(problem_tables(spec.problem, units)),
        document=text if len(text) <= _LONGEST_DOCUMENT else None,
        **({} if result is None else _of_result(spec, result, units)),
    )


def _blocks(spec: JobSpec) -> Iterator[Block]:
    """The equations: of the problem, and of the plant where another one is flown."""
    yield from model_blocks(spec.problem.submitted_model)
    yield from problem_blocks(spec.problem)
    if isinstance(spec.method, PiecewiseMethod) and spec.method.plant is not None:
        for block in model_blocks(spec.method.plant.model):
            yield replace(block, title=f"Plant: {block.title}")


def _of_result(spec: JobSpec, result: Mapping[str, Any], units: Mapping[str, str]) -> dict[str, Any]:
    return {
        "pictures": [_inline(svg, number) for number, svg in enumerate(render_parts(result))],
        "answer_tables": list(answer_tables(result, units)),
        "verification_tables": list(verification_tables(result)),
        "review_tables": list(review_tables(result)),
        "provenance": provenance_table(result),
    }


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("app.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.jinja")


def _verdict(result: Mapping[str, Any] | None, job: Mapping[str, Any] | None) -> tuple[str, str, str]:
    """A class of the style sheet, and what stands on top: the verdict and its reason."""
    if result is None:
        job = job or {}
        reason = (job.get("error") or {}).get("detail") or "There is no result."
        return "bad", f"Not solved: {job.get('status', 'failed')}", reason
    if result["success"]:
        return "good", "Solved and verified", result["message"]
    return "bad", f"Not solved: {result['status'].replace('_', ' ')}", result["message"]


def _summary(
    spec: JobSpec, result: Mapping[str, Any] | None, job: Mapping[str, Any] | None, units: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    method = dict(spec.method.model_dump(exclude_none=True)) if result is None else result["method"]
    yield "method", ", ".join(f"{key} {_short(value)}" for key, value in method.items()).removeprefix("name ")
    if result is not None:
        yield "objective", figure(result["objective"], 12)
        yield with_unit("final time", {"final time": units.get("t", "")}), figure(result["final_time"], 12)
        for key in ("energy", "penalty", "residual"):
            if key in result:
                yield key, figure(result[key], 8)
    if job is not None:
        yield "job", job["id"]
        yield "submitted", job["created_at"]
        yield "finished", figure(job["finished_at"])
        yield "attempts", str(job["attempts"])
    if spec.tags:
        yield "tags", ", ".join(spec.tags)


def _short(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 60 else text[:59] + "…"


def _inline(svg: bytes, number: int) -> Markup:
    """A picture inside the page: without its prologue, its ids its own."""
    text = svg.decode()
    text = text[text.index("<svg") :]
    # Written by matplotlib, which escapes every name.
    return Markup(_REFERENCE.sub(rf"\1picture{number}-", text))  # noqa: S704
