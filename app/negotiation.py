"""What a client says in its headers: what it sends, what it wants to read, how long it would wait."""

from __future__ import annotations

import re
from collections.abc import Mapping
from email.message import Message

from fastapi import Request

from app.auth import principal_of
from app.errors import ServiceError, wrong_parameter

LONGEST_WAIT = 60.0
"""Most that an answer is delayed on a client's wish, in seconds."""

MAX_KEY = 255


async def json_body(request: Request) -> bytes:
    """Return the body of a request that says that it is JSON; raises 415 for any other."""
    said = request.headers.get("content-type", "none/none")
    media, charset = (said, "utf-8") if said == "application/json" else _parts(said)
    if not (media == "application/json" or (media.startswith("application/") and media.endswith("+json"))):
        raise ServiceError("unsupported-media-type", headers={"Accept-Post": "application/json"})
    if charset not in ("utf-8", "utf8", "us-ascii"):
        raise ServiceError("unsupported-media-type", "The document must be in UTF-8.")
    if request.headers.get("content-encoding", "identity").lower() != "identity":
        raise ServiceError("unsupported-media-type", "Send the document as it is, not compressed.")
    return await request.body()


def _parts(content_type: str) -> tuple[str, str]:
    kind = Message()
    kind["Content-Type"] = content_type
    return kind.get_content_type(), str(kind.get_param("charset", "utf-8")).lower()


async def idempotency_key(request: Request) -> str | None:
    """Return the Idempotency-Key of a request, with the API key for which alone it counts.

    Raises 422 for one that is empty or too long.
    """
    key = request.headers.get("idempotency-key")
    if key is None:
        return None
    if not 0 < len(key) <= MAX_KEY:
        raise wrong_parameter("Idempotency-Key", f"must have 1 to {MAX_KEY} characters")
    whose = principal_of(request).key
    return key if whose is None else f"{whose}\0{key}"


def preferred_wait(request: Request) -> float | None:
    """Return for how many seconds the answer may be delayed (``Prefer: wait=N``, RFC 7240), at most 60.

    A preference that cannot be read is ignored, as the RFC wants it.
    """
    for preference in ",".join(request.headers.getlist("prefer")).split(","):
        match = re.fullmatch(r'\s*wait\s*=\s*"?(\d{1,9})"?\s*(;.*)?', preference, re.IGNORECASE)
        if match:
            return min(float(match[1]), LONGEST_WAIT)
    return None


def matches_etag(request: Request, etag: str) -> bool:
    """Tell whether ``If-None-Match`` lists this entity tag (compared weakly, RFC 9110)."""
    listed = request.headers.get("if-none-match")
    if listed is None:
        return False
    tags = [tag.strip().removeprefix("W/") for tag in listed.split(",")]
    return "*" in tags or etag in tags


def chosen_type(request: Request, offered: Mapping[str, str]) -> str:
    """Return the format that suits the client best: a key of ``offered`` (format -> media type).

    ``?format=`` goes before ``Accept``; among equals the first one offered wins. Raises 406.
    """
    wanted = request.query_params.get("format")
    if wanted is not None:
        if wanted in offered:
            return wanted
        raise ServiceError("not-acceptable", f"The formats are {', '.join(offered)}.")
    ranges = _ranges(request.headers.get("accept", "*/*") or "*/*")
    best, quality = "", 0.0
    for name, media in offered.items():
        if (q := _quality(media, ranges)) > quality:
            best, quality = name, q
    if not best:
        raise ServiceError("not-acceptable", f"The media types are {', '.join(offered.values())}.")
    return best


def encodings(request: Request) -> set[str]:
    """Return the codings in which a client takes an answer (``Accept-Encoding``)."""
    offered = _ranges(request.headers.get("accept-encoding", ""))
    return {coding for coding, quality in offered.items() if coding and quality > 0}


def _ranges(accept: str) -> dict[str, float]:
    ranges: dict[str, float] = {}
    for item in accept.split(","):
        media, *parameters = (part.strip().lower() for part in item.split(";"))
        q = next((text[2:] for text in parameters if text.startswith("q=")), "1")
        ranges[media] = float(q) if re.fullmatch(r"[01](\.\d{0,3})?", q) else 0.0
    return ranges


def _quality(media: str, ranges: Mapping[str, float]) -> float:
    family = f"{media.partition('/')[0]}/*"
    return next((ranges[name] for name in (media, family, "*/*") if name in ranges), 0.0)
