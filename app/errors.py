"""Every way in which a request can be refused, and the one handler that says so (RFC 9457)."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from redis import RedisError
from redis import exceptions as redis_errors
from starlette.exceptions import HTTPException

from app.problems import PROBLEMS
from solvers.errors import DocumentError, Fault, OndeletteError
from worker.claims import KeyInFlight, KeyReused
from worker.errors import (
    JobActive,
    JobGone,
    JobNotFound,
    QueueUnavailable,
    ResultLost,
    ResultsUnavailable,
    reason_of,
    takes_nothing,
)

logger = logging.getLogger(__name__)

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
    if isinstance(error, _SILENCE) and request.method == "POST":
        # What was sent before the broker fell silent may be done by it.
        return ServiceError("unavailable", f"{_AWAY} {_PERHAPS_TAKEN}", headers=refusal_of(error).headers)
    if isinstance(error, DocumentError):
        return _bad_document(error.faults)
    if isinstance(error, RequestValidationError):
        return _bad_parameters(error)
    if isinstance(error, HTTPException):
        return _of_framework(request, error)
    return refusal_of(error)


def refusal_of(error: Exception) -> ServiceError:
    """Return what one of `REFUSED` means to whoever asks; raises an error of the broker that is our own."""
    if isinstance(error, ServiceError):
        return error
    if isinstance(error, RedisError):
        if not (isinstance(error, _SILENCE) or takes_nothing(error)):
            raise error
        # Whoever asks learns nothing of what is behind the service; its operator has to.
        logger.warning("the broker: %s", reason_of(error))
        name, detail = "unavailable", _AWAY if isinstance(error, _SILENCE) else _TAKES_NOTHING
    else:
        name, detail = next(words for kind, words in _TRANSLATIONS.items() if isinstance(error, kind))
    return ServiceError(name, detail, headers=_RETRY_AFTER.get(name) or _RETRY_AFTER.get(type(error)))


_SILENCE = (redis_errors.ConnectionError, redis_errors.TimeoutError)
_AWAY = "The broker does not answer."
_TAKES_NOTHING = "The broker takes nothing new: it is full, or cannot write; nothing was accepted."
_PERHAPS_TAKEN = (
    "A submission may have been taken all the same: send it again with the Idempotency-Key that it had, or "
    "look for it in the list of jobs first."
)

_TRANSLATIONS: Mapping[type[Exception], tuple[str, str]] = {
    JobNotFound: ("not-found", "There is no job with this id, and no sweep."),
    JobGone: ("gone", "The job was erased, or the time for which it was kept has passed."),
    ResultLost: ("result-lost", PROBLEMS["result-lost"].explanation),
    ResultsUnavailable: ("unavailable", "The place where results are kept does not answer; try again."),
    JobActive: ("conflict", "The job is still active; cancel it first, or wait until it has ended."),
    KeyInFlight: ("conflict", "The first request with this Idempotency-Key is not answered yet; try again."),
    KeyReused: ("key-reused", PROBLEMS["key-reused"].explanation),
    QueueUnavailable: ("unavailable", f"{_AWAY} Nothing was accepted."),
}
_RETRY_AFTER: Mapping[str | type[Exception], Mapping[str, str]] = {
    "unavailable": {"Retry-After": "5"},
    KeyInFlight: {"Retry-After": "1"},
}


REFUSED: tuple[type[Exception], ...] = (ServiceError, RedisError, *_TRANSLATIONS)
"""Errors that are an answer, wherever they are raised (of a broker, those that it is to blame for)."""


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
        {"parameter": str(fault["loc"][-1]), "detail": _in_words(fault)}
        for fault in error.errors()[:MAX_FAULTS]
    ]
    return ServiceError("invalid-request", f"{listed[0]['parameter']}: {listed[0]['detail']}", errors=listed)


_WORDS: Mapping[str, str] = {
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than_equal": "must be at most {le:,}, the limit",
    "int_parsing": "must be a whole number",
    "float_parsing": "must be a number",
    "finite_number": "must be finite",
    "bool_parsing": "must be 1 or 0, true or false",
    "enum": "must be {expected}",
    "literal_error": "must be {expected}",
}


def _in_words(fault: Mapping[str, Any]) -> str:
    """What is wrong with a parameter, in the words that mistakes of documents have."""
    words = _WORDS.get(fault["type"])
    return str(fault["msg"]) if words is None else words.format(**fault.get("ctx", {}))


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
