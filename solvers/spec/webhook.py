"""Whom to tell when a job has ended."""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import urlsplit

from solvers.spec.base import SpecModel
from solvers.spec.faults import kind_of, refuse
from solvers.spec.fields import Check
from solvers.spec.scope import Scope

MAX_URL = 2048


class WebAddress(Check):
    """An http or https address of at most 2,048 characters, without user name and fragment."""

    def check(self, value: Any, scope: Scope) -> str:
        """Return the address."""
        if not isinstance(value, str):
            raise refuse(f"must be text, not {kind_of(value)}")
        if len(value) > MAX_URL:
            raise refuse(f"limit: at most {MAX_URL:,} characters, not {len(value):,}", type="limit")
        if not value.isascii() or not value.isprintable() or " " in value or "\\" in value:
            raise refuse("must be written in printable ASCII characters, without spaces")
        try:
            parts = urlsplit(value)
            host, _ = parts.hostname, parts.port
        except ValueError:
            raise refuse("is no address: its host or port cannot be read") from None
        if parts.scheme not in ("http", "https") or not host:
            raise refuse("must be an address such as https://host/path")
        if parts.username is not None or parts.password is not None or parts.fragment:
            raise refuse("must have neither a user name nor a fragment")
        return value

    def schema(self) -> dict[str, Any]:
        """A URI."""
        return {"type": "string", "format": "uri", "maxLength": MAX_URL}


class Webhook(SpecModel):
    """Whom to tell when the job has ended; only where the operator of the service allows it."""

    url: Annotated[str, WebAddress()]
    """Where a message is posted to."""
