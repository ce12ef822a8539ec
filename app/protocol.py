"""How what is no HTTP is refused: like everything else."""

from __future__ import annotations

import logging
import uuid

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol

from app.errors import ServiceError, problem_response
from app.middleware import SECURITY_HEADERS

logger = logging.getLogger(__name__)


class ProblemProtocol(HttpToolsProtocol):
    """uvicorn's reader of HTTP, which answers by itself what it cannot read, in the words of this service."""

    def send_400_response(self, msg: str) -> None:
        """Refuse a request before which no application stands."""
        request_id = uuid.uuid4().hex
        logger.info("request %s: %s", request_id, msg)
        refusal = problem_response(ServiceError("bad-request"), request_id)
        refusal.headers.update({**SECURITY_HEADERS, "X-Request-Id": request_id, "Connection": "close"})
        lines = [*self.server_state.default_headers, *refusal.raw_headers]
        head = b"".join(b"%b: %b\r\n" % line for line in lines)
        self.transport.write(STATUS_LINE[400] + head + b"\r\n" + bytes(refusal.body))
        self.transport.close()
