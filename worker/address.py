"""The broker's address in the two spellings that its clients want.

The address is written once (``ONDELETTE_BROKER``): ``redis://host:port/db``, ``rediss://...`` or a Unix
socket as ``unix:///path?db=0`` or ``redis+socket:///path?virtual_host=0``. redis-py knows the first spelling
of a socket only, Celery (kombu) the second only.
"""

from __future__ import annotations

from urllib.parse import parse_qsl, urlencode, urlsplit

_DATABASE_KEY = {"unix": "db", "redis+socket": "virtual_host"}
_TCP = ("redis", "rediss")


def redis_url(address: str) -> str:
    """Return ``address`` as redis-py reads it. Raises ValueError for what is neither TCP nor socket."""
    return _respelled(address, "unix")


def celery_url(address: str) -> str:
    """Return ``address`` as Celery reads it. Raises ValueError for what is neither TCP nor socket."""
    return _respelled(address, "redis+socket")


def _respelled(address: str, socket_scheme: str) -> str:
    parts = urlsplit(address)
    if parts.scheme in _TCP and parts.hostname:
        return address
    if parts.scheme not in _DATABASE_KEY or not parts.path.startswith("/"):
        raise ValueError(
            "the broker's address must look like redis://host:6379/0, rediss://host:6379/0 or unix:///path/to/socket"
        )
    query = [
        (_DATABASE_KEY[socket_scheme] if key in _DATABASE_KEY.values() else key, value)
        for key, value in parse_qsl(parts.query)
    ]
    # Written out by hand: urlunsplit drops the empty host of schemes that it does not know.
    return f"{socket_scheme}://{parts.netloc}{parts.path}" + (f"?{urlencode(query)}" if query else "")
