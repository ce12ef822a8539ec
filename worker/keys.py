"""API keys: who may do what in which project.

A key is ``ond_<id>_<secret>``. The secret has 256 bits, so that a plain SHA-256 of the key is as good as the
key is long, and nothing but that is stored: the key itself is shown once, when it is made.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import re
import secrets
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import cast

from redis import Redis

from solvers.errors import OndeletteError
from worker.settings import QueueSettings

_KEY = re.compile(r"ond_([0-9a-f]{12})_[A-Za-z0-9_-]{43}")
_PREFIX = "ond_"
_PROJECT = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


class Scope(StrEnum):
    """What a key allows; ``admin`` allows everything within its project, and the metrics."""

    SUBMIT = "submit"
    READ = "read"
    CANCEL = "cancel"
    METRICS = "metrics"
    ADMIN = "admin"


class KeyUnknown(OndeletteError):
    """There is no key with this id."""


@dataclass(frozen=True, slots=True)
class ApiKey:
    """What is remembered of a key; times in seconds since 1970, UTC."""

    id: str
    name: str
    project: str
    scopes: frozenset[Scope]
    created_at: float
    expires_at: float | None = None
    revoked_at: float | None = None

    @property
    def prefix(self) -> str:
        """How the key begins, by which people recognise it."""
        return f"{_PREFIX}{self.id}"

    def valid(self, now: float) -> bool:
        """Tell whether the key opens anything."""
        return self.revoked_at is None and (self.expires_at is None or now < self.expires_at)


class KeyStore:
    """All keys. Safe to share between threads; raises RedisError where the server does not answer."""

    def __init__(self, redis: Redis, settings: QueueSettings) -> None:
        self._redis = redis
        self._keys = f"{settings.prefix}keys"

    def create(
        self, name: str, project: str, scopes: Iterable[Scope], expires_at: float | None = None
    ) -> tuple[ApiKey, str]:
        """Make a key; returns its record and the key itself, which cannot be had again.

        Raises ValueError for a project that is no plain word of at most 64 characters.
        """
        if not _PROJECT.fullmatch(project):
            raise ValueError(
                "a project is a word of letters, digits, '.', '_' and '-', at most 64 characters long"
            )
        record = ApiKey(secrets.token_hex(6), name, project, frozenset(scopes), time.time(), expires_at)
        key = f"{record.prefix}_{secrets.token_urlsafe(32)}"
        self._write(record, digest(key))
        return record, key

    def find(self, key: str) -> ApiKey | None:
        """Return the record of a key that is valid now, None for anything else."""
        match = _KEY.fullmatch(key)
        if match is None:
            return None
        stored = cast(bytes | None, self._redis.hget(self._keys, match[1]))
        if stored is None:
            return None
        record, its_digest = _read(match[1], stored)
        same = hmac.compare_digest(its_digest, digest(key))
        return record if same and record.valid(time.time()) else None

    def list(self) -> list[ApiKey]:
        """List all keys, oldest first, those too that open nothing any more."""
        stored = cast(Mapping[bytes, bytes], self._redis.hgetall(self._keys))
        records = [_read(key_id.decode(), text)[0] for key_id, text in stored.items()]
        return sorted(records, key=lambda record: record.created_at)

    def revoke(self, key_id: str) -> ApiKey:
        """Take a key's effect away for good, by its id or its prefix; raises KeyUnknown."""
        key_id = key_id.removeprefix(_PREFIX)
        stored = cast(bytes | None, self._redis.hget(self._keys, key_id))
        if stored is None:
            raise KeyUnknown(f"there is no key with the id {key_id!r}")
        record, its_digest = _read(key_id, stored)
        revoked = ApiKey(
            record.id,
            record.name,
            record.project,
            record.scopes,
            record.created_at,
            record.expires_at,
            record.revoked_at or time.time(),
        )
        self._write(revoked, its_digest)
        return revoked

    def any(self) -> bool:
        """Tell whether keys were ever made: from then on nobody enters without one."""
        return bool(self._redis.exists(self._keys))

    def _write(self, record: ApiKey, its_digest: str) -> None:
        members = {
            "digest": its_digest,
            "name": record.name,
            "project": record.project,
            "scopes": sorted(record.scopes),
            "created_at": record.created_at,
            "expires_at": record.expires_at,
            "revoked_at": record.revoked_at,
        }
        self._redis.hset(self._keys, record.id, json.dumps(members))


def digest(key: str) -> str:
    """Return what is stored of a key."""
    return hashlib.sha256(key.encode()).hexdigest()


def _read(key_id: str, text: bytes) -> tuple[ApiKey, str]:
    members = json.loads(text)
    its_digest = members.pop("digest")
    scopes = frozenset(map(Scope, members.pop("scopes")))
    return ApiKey(id=key_id, scopes=scopes, **members), its_digest
