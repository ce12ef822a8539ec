"""The kinds of refusal, one for each problem type that the service answers with (RFC 9457)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Problem:
    """A kind of refusal: its HTTP status, its short title and what the reader should know of it."""

    status: int
    title: str
    explanation: str


PROBLEMS: Mapping[str, Problem] = {
    "bad-request": Problem(
        400,
        "Bad request",
        "The request could not be read as HTTP.",
    ),
    "invalid-host": Problem(
        400,
        "Unknown host",
        "The Host header names a host under which this service does not answer; this keeps web pages from"
        " reaching it through a name of their own. The operator lists further names in "
        "ONDELETTE_ALLOWED_HOSTS.",
    ),
    "unauthorized": Problem(
        401,
        "Unauthorized",
        "This service asks for an API key: send it as Authorization: Bearer. The operator makes keys with "
        "ondelette keys create.",
    ),
    "forbidden": Problem(
        403,
        "Forbidden",
        "The API key is known but lacks the scope (submit, read, cancel, metrics or admin) that this "
        "request needs.",
    ),
    "not-found": Problem(
        404,
        "Not found",
        "There is nothing at this address, or no job with this id.",
    ),
    "no-result": Problem(
        404,
        "No result",
        "The job has ended without any iterate, so it has no result; its error says why.",
    ),
    "result-lost": Problem(
        404,
        "Result lost",
        "The job had a result, but where results are kept it is not there any more, or damaged. Its document "
        "is: submit it again, and let the operator look for what was deleted.",
    ),
    "method-not-allowed": Problem(
        405,
        "Method not allowed",
        "The Allow header lists the methods of this address.",
    ),
    "not-acceptable": Problem(
        406,
        "Not acceptable",
        "The result is available as application/json, text/csv, application/x-npz and "
        "application/x-matlab-data; ask for one of these in Accept, or write ?format=json, csv, npz or "
        "mat.",
    ),
    "conflict": Problem(
        409,
        "Conflict",
        "The request does not go with the present state: an active job cannot be erased, and an "
        "Idempotency-Key whose first request is not answered yet cannot be used again.",
    ),
    "not-ready": Problem(
        409,
        "Not ready",
        "The job is still active; its result can be read when its status is final.",
    ),
    "gone": Problem(
        410,
        "Gone",
        "The job was erased, or the time for which finished jobs are kept has passed.",
    ),
    "too-large": Problem(
        413,
        "Too large",
        "The body of the request is larger than this service reads.",
    ),
    "unsupported-media-type": Problem(
        415,
        "Unsupported media type",
        "Send the document as application/json in UTF-8, not compressed.",
    ),
    "invalid-document": Problem(
        422,
        "Invalid document",
        "The job document cannot be solved as it stands. Every mistake is listed under errors: pointer is"
        " a JSON pointer into the document, detail says what is wrong and what would be right, and type "
        "tells a mistake (invalid) from a size limit (limit) and from what this version does not do yet "
        "(unsupported).",
    ),
    "unsupported": Problem(
        422,
        "Unsupported document",
        "The document is well-formed but asks for something that this version does not do yet; errors "
        "lists it.",
    ),
    "invalid-request": Problem(
        422,
        "Invalid request",
        "A parameter or header of the request is wrong; errors lists which, and why.",
    ),
    "key-reused": Problem(
        422,
        "Idempotency key reused",
        "This Idempotency-Key was used with another body before; choose a new one.",
    ),
    "rate-limited": Problem(
        429,
        "Too many requests",
        "The API key has made too many requests in a short time; Retry-After says when it may make the "
        "next one, RateLimit and RateLimit-Policy what it may make.",
    ),
    "quota-exceeded": Problem(
        429,
        "Quota exceeded",
        "The project of the API key has as many active jobs as it may have; submit again when some have "
        "ended.",
    ),
    "too-many-waiting": Problem(
        429,
        "Too many waiting requests",
        "As many streams of events and delayed answers are open as the project, or one process of the "
        "service, may have; ask again when some have ended, or ask without waiting.",
    ),
    "internal": Problem(
        500,
        "Internal error",
        "Something went wrong that should not have. The request id finds the cause in the service's log.",
    ),
    "queue-full": Problem(
        503,
        "Queue full",
        "As many jobs wait as this service takes. Nothing was accepted; try again after the time that "
        "Retry-After gives.",
    ),
    "unavailable": Problem(
        503,
        "Unavailable",
        "The broker or the place of results cannot be reached or takes nothing new, or no worker is alive; "
        "detail says which. Try again after the time that Retry-After gives, a submission with the "
        "Idempotency-Key that it had.",
    ),
}
