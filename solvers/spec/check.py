"""A document checked as a whole."""

from __future__ import annotations

from itertools import islice
from typing import Any

from pydantic import ValidationError

from solvers.errors import DocumentError, Fault
from solvers.spec.crosschecks import cross_check
from solvers.spec.document import parse_document, walk
from solvers.spec.faults import MAX_FAULTS, Flaws, kind_of
from solvers.spec.job import JobSpec
from solvers.spec.scope import read_scope
from solvers.spec.translate import translate


def check_document(document: object) -> JobSpec:
    """Return the checked form of a job document (what JSON or YAML stood for).

    Raises DocumentError with every mistake of the document at once: structure, names, shapes, bounds,
    limits, and what this version does not do.
    """
    flaws = Flaws()
    walk(document, flaws)
    if flaws.found:
        raise DocumentError(flaws.faults())
    return _check(document)


def check_text(raw: bytes | str) -> JobSpec:
    """Return the checked form of a job document that is JSON text; raises DocumentError."""
    document = parse_document(raw)  # which has looked at every value
    return _check(document)


def _check(document: object) -> JobSpec:
    if not isinstance(document, dict):
        raise DocumentError([Fault("", f"a job document is an object, not {kind_of(document)}")])
    scope = read_scope(document)
    spec: JobSpec | None = None
    faults: list[Fault] = []
    try:
        spec = JobSpec.model_validate(document, context=scope)
    except ValidationError as error:
        faults.extend(islice(translate(error, scope), MAX_FAULTS))
    faults.extend(cross_check(scope).faults())
    if spec is None or faults:
        raise DocumentError(list(dict.fromkeys(faults))[:MAX_FAULTS])
    return spec


def job_schema() -> dict[str, Any]:
    """Return the JSON Schema of a job document."""
    return JobSpec.model_json_schema(by_alias=True)
