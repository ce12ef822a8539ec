"""Every way in which a request can be refused, and the one handler that says so (RFC 9457)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from redis import exceptions as redis_errors
from starlette.exceptions import HTTPException

from app.problems import PROBLEMS
from solvers.errors import DocumentError, Fault, OndeletteError
from worker.claims import KeyInFlight, KeyReused
from worker.errors import JobActive, JobGone, JobNotFound, QueueUnavailable, ResultLost, ResultsUnavailable

PROBLEM_JSON = "application/problem+json"
MAX_FAULTS = 50
"""Most mistakes of a document that are listed in one answer."""


class ServiceError(OndeletteError):
    """A refusal: the name of its `Problem`, and what is particular to this request.

    ``errors`` lists mistakes, each with ``pointer`` (into the document) or ``parameter`` (of the request) and
    ``detail``; ``headers`` are added to the answer.
    """

    def __init__(
        self,
        problem: str,
        detail: str | None = None,
        *,
        errors: Sequence[Mapping[str, str]] = (),
        headers: Mapping[str, str] | None = None,
    ) -> None:
        self.name = problem
        self.problem = PROBLEMS[problem]
        self.detail = detail or self.problem.explanation
        self.errors = errors
        self.headers = dict(headers or {})
        super().__init__(self.detail)


def wrong_parameter(name: str, detail: str) -> ServiceError:
    """Return the refusal of a query parameter or header."""
    return ServiceError(
        "invalid-request", f"{name}: {detail}", errors=[{"parameter": name, "detail": detail}]
    )


def problem_response(error: ServiceError, request_id: str) -> Response:
    """Return a refusal as problem+json."""
    members: dict[str, Any] = {
        "type": f"/problems/{error.name}",
        "title": error.problem.title,
        "status": error.problem.status,
        "detail": error.detail,
        "request_id": request_id,
    }
    if error.errors:
        members["errors"] = list(error.errors)
    return Response(json.dumps(members), error.problem.status, error.headers, PROBLEM_JSON)


def install(app: FastAPI) -> None:
    """Make every error that a handler may raise on purpose, and those of the framework, a problem."""
    for kind in (*REFUSED, DocumentError, RequestValidationError, HTTPException):
        app.add_exception_handler(kind, _handle)


async def _handle(request: Request, error: Exception) -> Response:
    return problem_response(_refusal(request, error), request.state.request_id)


def _refusal(request: Request, error: Exception) -> ServiceError:
    if isinstance(error, DocumentError):
        return _bad_document(error.faults)
    if isinstance(error, RequestValidationError):
        return _bad_parameters(error)
    if isinstance(error, HTTPException):
        return _of_framework(request, error)
    return refusal_of(error)


def refusal_of(error: Exception) -> ServiceError:
    """Return what one of `REFUSED` means to whoever asks."""
    if isinstance(error, ServiceError):
        return error
    return next(
        ServiceError(name, detail, headers={"Retry-After": "5"} if name == "unavailable" else {})
        for kind, (name, detail) in _TRANSLATIONS.items()
        if isinstance(error, kind)
    )


_AWAY = ("unavailable", "The broker does not answer or takes no more; nothing was accepted.")

_TRANSLATIONS: Mapping[type[Exception], tuple[str, str]] = {
    JobNotFound: ("not-found", "There is no job with this id, and no sweep."),
    JobGone: ("gone", "The job was erased, or the time for which it was kept has passed."),
    ResultLost: ("result-lost", PROBLEMS["result-lost"].explanation),
    ResultsUnavailable: ("unavailable", "The place where results are kept does not answer; try again."),
    JobActive: ("conflict", "The job is still active; cancel it first, or wait until it has ended."),
    KeyInFlight: ("conflict", "The first request with this Idempotency-Key is not answered yet; try again."),
    KeyReused: ("key-reused", PROBLEMS["key-reused"].explanation),
    QueueUnavailable: _AWAY,
    redis_errors.ConnectionError: _AWAY,
    redis_errors.TimeoutError: _AWAY,
    redis_errors.OutOfMemoryError: _AWAY,
    redis_errors.ReadOnlyError: _AWAY,
}


REFUSED: tuple[type[Exception], ...] = (ServiceError, *_TRANSLATIONS)
"""Errors that are an answer, wherever they are raised."""


def _bad_document(faults: Sequence[Fault]) -> ServiceError:
    listed = [
        {"pointer": fault.pointer, "detail": fault.detail, "type": fault.type}
        for fault in faults[:MAX_FAULTS]
    ]
    count = "one mistake" if len(faults) == 1 else f"{len(faults):,} mistakes"
    more = f"; the first {MAX_FAULTS} are listed" if len(faults) > MAX_FAULTS else ""
    first = f"{faults[0].pointer}: {faults[0].detail}" if faults[0].pointer else faults[0].detail
    name = "unsupported" if all(fault.type == "unsupported" for fault in faults) else "invalid-document"
    return ServiceError(name, f"The document has {count}{more}. First: {first}", errors=listed)


def _bad_parameters(error: RequestValidationError) -> ServiceError:
    # Only where and what: the input itself is not sent back.
    listed = [
        {"parameter": str(fault["loc"][-1]), "detail": str(fault["msg"])}
        for fault in error.errors()[:MAX_FAULTS]
    ]
    return ServiceError("invalid-request", f"{listed[0]['parameter']}: {listed[0]['detail']}", errors=listed)


def _of_framework(request: Request, error: HTTPException) -> ServiceError:
    if error.status_code == 405:
        return ServiceError("method-not-allowed", headers={"Allow": _allowed(request)})
    name = {404: "not-found", 406: "not-acceptable", 413: "too-large", 415: "unsupported-media-type"}.get(
        error.status_code, "bad-request" if error.status_code < 500 else "internal"
    )
    return ServiceError(name, headers=error.headers)


def _allowed(request: Request) -> str:
    """Return the methods of all routes at this address: the framework looks at the first one only."""
    methods = []
    for method in ("GET", "POST", "DELETE"):
        scope = {**request.scope, "method": method}
        if any(route.matches(scope)[0].name == "FULL" for route in request.app.routes):
            methods += ["GET", "HEAD"] if method == "GET" else [method]
    return ", ".join(methods)
