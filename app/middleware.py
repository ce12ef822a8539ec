"""What happens to every request before a route sees it: its id, its host, the size of its body."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import uuid

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.errors import ServiceError, problem_response

logger = logging.getLogger(__name__)

_REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")

SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    # Answers are data; a page that is one brings its own policy.
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
}
"""Headers of every answer, unless it has its own."""


class RequestContext:
    """Gives each request an id, each answer the security headers, and what nobody caught a problem.

    A client's own ``X-Request-Id`` is kept if it is a plain word of at most 64 characters.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        given = Headers(scope=scope).get("X-Request-Id", "")
        request_id = given if _REQUEST_ID.fullmatch(given) else uuid.uuid4().hex
        scope.setdefault("state", {})["request_id"] = request_id
        started = False

        async def send_with_headers(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                headers = MutableHeaders(scope=message)
                headers["X-Request-Id"] = request_id
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                if scope["scheme"] == "https":
                    headers.setdefault("Strict-Transport-Security", "max-age=31536000")
            await send(message)

        try:
            await self._app(scope, receive, send_with_headers)
        except Exception:
            if started:
                raise
            logger.exception("request %s: %s %s", request_id, scope["method"], scope["path"])
            await problem_response(ServiceError("internal"), request_id)(scope, receive, send_with_headers)


class _HeadersSent(Exception):
    """All of an answer that a client asked for is sent."""


class HeadAsGet:
    """Answers HEAD as the same GET, without the content (RFC 9110, section 9.3.2), whatever the route."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return

        async def send_headers(message: Message) -> None:
            if message["type"] != "http.response.body":
                await send(message)
                return
            await send({"type": "http.response.body", "body": b""})
            if message.get("more_body", False):
                # A stream would go on for nobody.
                raise _HeadersSent

        with contextlib.suppress(_HeadersSent):
            await self._app({**scope, "method": "GET"}, receive, send_headers)


class HostGuard:
    """Refuses requests that ask for another host: a page on the web could otherwise reach a service at home.

    Allowed are the ``names`` and the address at which the connection arrived; ``*`` allows every name.
    """

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self._app = app
        self._names = names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on if its Host header is allowed."""
        if scope["type"] == "http" and not self._allowed(scope):
            refusal = problem_response(ServiceError("invalid-host"), scope["state"]["request_id"])
            await refusal(scope, receive, send)
            return
        await self._app(scope, receive, send)

    def _allowed(self, scope: Scope) -> bool:
        if "*" in self._names:
            return True
        host = _without_port(Headers(scope=scope).get("host", ""))
        server = scope.get("server")
        return host in self._names or (server is not None and host == server[0])


def _without_port(host: str) -> str:
    name = host.rpartition(":")[0] if re.search(r":\d*$", host) else host
    return name.removeprefix("[").removesuffix("]").lower()


class _BodyTooLarge(Exception):
    """The body has grown beyond the limit."""


class BodyLimit:
    """Refuses bodies of more than ``limit`` bytes: by their announced length, else while they stream in."""

    # What is still read and thrown away of a refused body, and for how long: a client that is cut off in the
    # middle of its sending may never see the answer.
    _DRAIN_BYTES = 256 * 2**20
    _DRAIN_SECONDS = 10.0

    def __init__(self, app: ASGIApp, limit: int) -> None:
        self._app = app
        self._limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on with a body that cannot grow beyond the limit."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        length = headers.get("content-length", "")
        if length.isdecimal() and (len(length) > 18 or int(length) > self._limit):
            # A client that asks first (Expect: 100-continue) has its answer before it sends anything.
            if headers.get("expect", "").lower() != "100-continue":
                await self._drain(receive)
            await self._refuse(scope, receive, send)
            return
        size = 0
        started = False

        async def receive_counted() -> Message:
            nonlocal size
            message = await receive()
            size += len(message.get("body", b""))
            if size > self._limit:
                raise _BodyTooLarge
            return message

        async def send_noted(message: Message) -> None:
            nonlocal started
            started = True
            await send(message)

        try:
            await self._app(scope, receive_counted, send_noted)
        except _BodyTooLarge:
            if started:
                raise
            await self._drain(receive)
            await self._refuse(scope, receive, send)

    async def _refuse(self, scope: Scope, receive: Receive, send: Send) -> None:
        error = ServiceError(
            "too-large",
            f"The body has more than {self._limit:,} bytes, the limit of this service.",
            headers={"Connection": "close"},
        )
        await problem_response(error, scope["state"]["request_id"])(scope, receive, send)

    async def _drain(self, receive: Receive) -> None:
        left = self._DRAIN_BYTES
        try:
            async with asyncio.timeout(self._DRAIN_SECONDS):
                while left > 0:
                    message = await receive()
                    left -= len(message.get("body", b""))
                    if not message.get("more_body", False):
                        return
        except TimeoutError:
            logger.info("a refused body was still being sent after %s s", self._DRAIN_SECONDS)
