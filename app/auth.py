"""Who asks, and whether he may: the gate before every route.

Everything under ``/v1`` and ``/metrics`` is behind it, whatever route is added there; the pages, the
description of the interface and the probes are not. Without any key in the store (and without a bootstrap
key), and unless the settings ask for keys, everybody who reaches the service is its owner: it then listens to
its own machine only.
"""

from __future__ import annotations

import hmac
import math
import re
import time
from dataclasses import dataclass, field
from pathlib import Path

from fastapi import Request
from redis.exceptions import RedisError
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Send
from starlette.types import Scope as AsgiScope

from app.errors import REFUSED, ServiceError, problem_response, refusal_of
from app.settings import Settings
from worker.errors import JobGone, JobNotFound, takes_nothing
from worker.keys import ApiKey, KeyStore, Scope, digest
from worker.rates import PERIOD, Grant, RateLimiter
from worker.records import DEFAULT_PROJECT
from worker.store import JobStore, connect
from worker.sweeps import SweepStore

_STATELESS = re.compile(r"/v1/(validate|models|methods|cases(/.*)?)")
_OWNED = re.compile(r"/v1/(jobs|sweeps)/([^/]+)")
_EVERYTHING = frozenset(Scope)
_REMEMBERED = 1024
SHORTEST_BOOTSTRAP_KEY = 32
"""Least length of a bootstrap key, in characters."""


@dataclass(frozen=True, slots=True)
class Principal:
    """Who asks: ``key`` is the id of his key; without keys there is only one, who sees every project."""

    key: str | None = None
    project: str = DEFAULT_PROJECT
    scopes: frozenset[Scope] = _EVERYTHING

    def may(self, scope: Scope) -> bool:
        """Tell whether the key has a scope."""
        return scope in self.scopes or Scope.ADMIN in self.scopes

    @property
    def only(self) -> str | None:
        """The project whose jobs he sees, None for all."""
        return None if self.key is None else self.project


OWNER = Principal()
"""Whoever reaches a service that has no keys."""


def principal_of(request: Request) -> Principal:
    """Return who makes a request."""
    principal: Principal = request.state.principal
    return principal


def needed_scope(method: str, path: str) -> Scope | None:
    """Return the scope that a request needs, None where no key is asked for."""
    if path == "/metrics":
        return Scope.METRICS
    if path != "/v1" and not path.startswith("/v1/"):
        return None
    if method in ("GET", "HEAD", "OPTIONS"):
        return Scope.READ
    if method == "DELETE" or path.endswith("/cancel"):
        return Scope.CANCEL
    return Scope.SUBMIT


def read_bootstrap_key(path: Path) -> str:
    """Return the key in a file; raises ValueError for one that is too short, OSError for none."""
    key = path.read_text().strip()
    if len(key) < SHORTEST_BOOTSTRAP_KEY or not key.isascii() or not key.isprintable() or " " in key:
        raise ValueError(
            f"{path} must hold one word of at least {SHORTEST_BOOTSTRAP_KEY} printable ASCII characters"
        )
    return key


def missing_keys(settings: Settings, *, stored: bool = True) -> str | None:
    """Return why nobody could enter a service that needs keys, None if somebody can.

    ``stored`` tells whether there is a server that may know keys. Raises RedisError where it does not answer.
    """
    if settings.bootstrap_key_file is not None:
        return None
    if stored:
        with connect(settings) as redis:
            if any(record.valid(time.time()) for record in KeyStore(redis, settings).list()):
                return None
    return (
        "it would be reached from beyond this machine, and there is no API key. Make one with ondelette keys "
        "create, or name a file with one in ONDELETTE_BOOTSTRAP_KEY_FILE; or add --insecure if a firewall or "
        "a proxy stands before it"
    )


@dataclass(slots=True)
class Visit:
    """What becomes of a request at the gate: it is let in where there is no ``refusal``."""

    principal: Principal = OWNER
    grant: Grant | None = None
    refusal: Exception | None = None


@dataclass(slots=True)
class Doorkeeper:
    """Knows keys, owners and rates; asks the store, and remembers keys for as long as the settings allow."""

    settings: Settings
    keys: KeyStore
    rates: RateLimiter
    jobs: JobStore
    sweeps: SweepStore
    bootstrap: str | None = None
    _known: dict[str, tuple[float, ApiKey]] = field(default_factory=dict)
    _locked_until: tuple[float, bool] = (0.0, False)

    def admit(self, token: str | None, method: str, path: str) -> Visit:
        """Return who asks, what is left of his rate, and why he may not, as far as each is known."""
        visit = Visit()
        try:
            self._admit(visit, token, method, path)
        except REFUSED as error:
            visit.refusal = error
        return visit

    def _admit(self, visit: Visit, token: str | None, method: str, path: str) -> None:
        needed = needed_scope(method, path)
        if needed is None:
            return
        try:
            if not self.locked():
                return
        except RedisError:
            if not _STATELESS.fullmatch(path):
                raise
            # Nobody's jobs are behind these, and no keys are asked for as far as is known.
            return
        visit.principal = self._identify(token)
        visit.grant = self._count(visit.principal, needed)
        if not visit.principal.may(needed):
            raise ServiceError("forbidden", f"This key has no scope {needed}.")
        if visit.grant is not None and not visit.grant.granted:
            raise _beyond_rate(visit.grant, needed)
        owned = _OWNED.match(path)
        if owned is not None and self._owner(*owned.groups()) not in (None, visit.principal.project):
            # As if there were none: nobody learns of the jobs of other projects.
            raise JobNotFound(owned[2])

    def open(self, method: str, path: str) -> bool:
        """Tell whether a request may pass without the store being asked."""
        until, locked = self._locked_until
        unlocked = not (locked or self._always_locked)
        return needed_scope(method, path) is None or (unlocked and time.monotonic() < until)

    def locked(self) -> bool:
        """Tell whether a key is needed."""
        if self._always_locked:
            return True
        now = time.monotonic()
        until, locked = self._locked_until
        if now >= until:
            # Once there was a key it stays so, even if the server loses its memory.
            locked = locked or self.keys.any()
            self._locked_until = now + self.settings.key_cache_seconds, locked
        return locked

    @property
    def _always_locked(self) -> bool:
        return self.settings.require_keys or self.bootstrap is not None

    def _identify(self, token: str | None) -> Principal:
        if token is None:
            raise _unauthorized("Send an API key: Authorization: Bearer ond_...")
        its_digest = digest(token)
        if self.bootstrap is not None and hmac.compare_digest(its_digest, self.bootstrap):
            return Principal("bootstrap", DEFAULT_PROJECT, frozenset({Scope.ADMIN}))
        until, record = self._known.get(its_digest, (0.0, None))
        if record is None or time.monotonic() >= until or not record.valid(time.time()):
            self._known.pop(its_digest, None)
            record = self.keys.find(token)
            if record is None:
                raise _unauthorized("This API key is unknown, has expired or was revoked.")
            if len(self._known) >= _REMEMBERED:
                self._known.clear()
            self._known[its_digest] = time.monotonic() + self.settings.key_cache_seconds, record
        return Principal(record.id, record.project, record.scopes)

    def _count(self, principal: Principal, needed: Scope) -> Grant | None:
        submits = needed is Scope.SUBMIT
        limit = self.settings.submit_rate if submits else self.settings.request_rate
        if not limit:
            return None
        try:
            return self.rates.take(f"{'submit' if submits else 'request'}:{principal.key}", limit)
        except RedisError as error:
            # That what is stored can be read, and room be made, matters more than how often.
            if submits or not takes_nothing(error):
                raise
            return None

    def _owner(self, kind: str, its_id: str) -> str | None:
        """The project that something belongs to, None where there is nothing."""
        try:
            return self.jobs.project(its_id) if kind == "jobs" else self.sweeps.get(its_id).project
        except (JobNotFound, JobGone):
            return None


def rate_headers(grant: Grant, needed: Scope | None) -> dict[str, str]:
    """Return the fields of draft-ietf-httpapi-ratelimit-headers."""
    name = "submit" if needed is Scope.SUBMIT else "request"
    return {
        "RateLimit-Policy": f'"{name}";q={grant.limit};w={PERIOD}',
        "RateLimit": f'"{name}";r={grant.remaining};t={grant.reset}',
    }


class Gate:
    """Lets requests in that the doorkeeper admits; their ``state.principal`` says who asks."""

    def __init__(self, app: ASGIApp, doorkeeper: Doorkeeper) -> None:
        self._app = app
        self._doorkeeper = doorkeeper

    async def __call__(self, scope: AsgiScope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer for it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        method, path = scope["method"], scope["path"]
        token = _bearer(Headers(scope=scope).get("authorization"))
        if self._doorkeeper.open(method, path):
            visit = Visit()
        else:
            visit = await run_in_threadpool(self._doorkeeper.admit, token, method, path)
        scope["state"]["principal"] = visit.principal

        async def send_with_rate(message: Message) -> None:
            if message["type"] == "http.response.start" and visit.grant is not None:
                headers = MutableHeaders(scope=message)
                headers.update(rate_headers(visit.grant, needed_scope(method, path)))
            await send(message)

        app: ASGIApp = self._app
        if visit.refusal is not None:
            app = problem_response(refusal_of(visit.refusal), scope["state"]["request_id"])
        await app(scope, receive, send_with_rate)


def _bearer(header: str | None) -> str | None:
    if header is None:
        return None
    scheme, _, token = header.partition(" ")
    return token.strip() if scheme.lower() == "bearer" and token.strip() else None


def _beyond_rate(grant: Grant, needed: Scope) -> ServiceError:
    asked = "submissions and validations" if needed is Scope.SUBMIT else "requests"
    detail = f"This key may make {grant.limit:,} {asked} a minute, and has made them; see Retry-After."
    return ServiceError("rate-limited", detail, headers={"Retry-After": str(math.ceil(grant.wait) or 1)})


def _unauthorized(detail: str) -> ServiceError:
    return ServiceError("unauthorized", detail, headers={"WWW-Authenticate": 'Bearer realm="ondelette"'})
