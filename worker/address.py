"""The broker's address in the two spellings that its clients want.

The address is written once (``ONDELETTE_BROKER``): ``redis://host:port/db``, ``rediss://...`` or a Unix
socket as ``unix:///path?db=0`` or ``redis+socket:///path?virtual_host=0``. redis-py knows the first spelling
of a socket only, Celery (kombu) the second only. Of TLS, kombu trusts everybody unless it is told not to, and
redis-py nobody without a certificate: both are told in words that both read.
"""

from __future__ import annotations

from urllib.parse import parse_qsl, urlencode, urlsplit

_DATABASE_KEY = {"unix": "db", "redis+socket": "virtual_host"}
_TCP = ("redis", "rediss")
_TRUST = ("required", "optional", "none")


def redis_url(address: str) -> str:
    """Return ``address`` as redis-py reads it. Raises ValueError for what is neither TCP nor socket."""
    return _respelled(address, "unix")


def celery_url(address: str) -> str:
    """Return ``address`` as Celery reads it. Raises ValueError for what is neither TCP nor socket."""
    return _respelled(address, "redis+socket")


def _respelled(address: str, socket_scheme: str) -> str:
    parts = urlsplit(address)
    if parts.scheme in _TCP and parts.hostname:
        return address if parts.scheme == "redis" else _distrustful(address)
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


def _distrustful(address: str) -> str:
    """Return an address by TLS that says whom to trust: by default, only who has a certificate."""
    before, _, query = address.partition("?")
    words = {"ssl_cert_reqs": "required", **dict(parse_qsl(query))}
    # Celery's documentation spells CERT_REQUIRED what redis-py knows as required.
    words["ssl_cert_reqs"] = words["ssl_cert_reqs"].lower().removeprefix("cert_")
    if words["ssl_cert_reqs"] not in _TRUST:
        raise ValueError(f"ssl_cert_reqs in the broker's address must be one of {', '.join(_TRUST)}")
    return f"{before}?{urlencode(words)}"
