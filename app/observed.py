"""What is told of every request: a line in the log. (Where traces are configured FastAPI makes it a span.)"""

from __future__ import annotations

import logging
import time

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from worker import logs

logger = logging.getLogger("ondelette.access")

# Asked every few seconds by machines: of interest only to who looks for them.
_PROBES = frozenset({"/livez", "/readyz", "/metrics"})


class Observed:
    """Logs each request with its id when it is answered.

    Of a request only method, path, status, time and the id of its key are told.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        with logs.about(request=scope["state"]["request_id"]):
            await self._observe(scope, receive, send)

    async def _observe(self, scope: Scope, receive: Receive, send: Send) -> None:
        began = time.perf_counter()
        status = 500

        async def send_noted(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, send_noted)
        finally:
            told = {
                "method": scope["method"],
                "path": scope["path"],
                "status": status,
                "seconds": round(time.perf_counter() - began, 6),
                "key": getattr(scope["state"].get("principal"), "key", None),
            }
            level = logging.DEBUG if scope["path"] in _PROBES else logging.INFO
            text = "%(method)s %(path)s %(status)s"
            logger.log(level, text, told, extra=told)
