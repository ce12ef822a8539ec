"""Log lines that machines can read, each with the request and the job that it is about.

Nothing of a document and no key is ever logged: whoever logs names ids. The request's id travels with the
message of its job, so that the lines of a worker are found by it too.
"""

from __future__ import annotations

import contextlib
import json
import logging
import re
import sys
from collections.abc import Iterator
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Literal

request_id: ContextVar[str | None] = ContextVar("request_id", default=None)
"""The request that is being answered, or that made the job that is being solved."""

job_id: ContextVar[str | None] = ContextVar("job_id", default=None)
"""The job that is being solved."""

Format = Literal["text", "json"]

_STANDARD = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName", "color_message"}


class JsonFormatter(logging.Formatter):
    """One JSON object a line: time, level, logger, message, ids, and whatever else the line carries."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        members = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **_ids(),
            **{name: value for name, value in vars(record).items() if name not in _STANDARD},
        }
        if record.exc_info:
            members["exception"] = self.formatException(record.exc_info)
        return json.dumps(members, default=str, ensure_ascii=False)


class TextFormatter(logging.Formatter):
    """Lines for people: time, level, message, ids."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """Return the line; what it is about stands at its end."""
        first, *rest = super().format(record).split("\n")
        named = re.findall(r"[\w.-]+", first)
        about = "".join(f" {name}={value}" for name, value in _ids().items() if value not in named)
        return "\n".join([first + about, *rest])


def _ids() -> dict[str, str]:
    found = {"request_id": request_id.get(), "job_id": job_id.get()}
    return {name: value for name, value in found.items() if value is not None}


def handler(format: Format) -> logging.Handler:
    """Return the handler that writes lines of a format to stderr."""
    made = logging.StreamHandler(sys.stderr)
    made.setFormatter(JsonFormatter() if format == "json" else TextFormatter())
    return made


def set_up(format: Format, level: str) -> None:
    """Send the lines of every logger to stderr, in one format."""
    root = logging.getLogger()
    root.handlers[:] = [handler(format)]
    root.setLevel(level)
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access"):
        logging.getLogger(name).handlers.clear()
        logging.getLogger(name).propagate = True
    # They tell of every request and of every message; we do that ourselves.
    for name in ("httpx", "httpcore", "celery.worker.strategy", "celery.app.trace"):
        logging.getLogger(name).setLevel(logging.WARNING)


@contextlib.contextmanager
def about(request: str | None = None, job: str | None = None) -> Iterator[None]:
    """Let the lines of this context say what they are about."""
    tokens = request_id.set(request or request_id.get()), job_id.set(job or job_id.get())
    try:
        yield
    finally:
        request_id.reset(tokens[0])
        job_id.reset(tokens[1])
