"""Everything that is remembered, in a file: to be kept elsewhere, and put back into any server.

The file is gzipped JSON, a line for each key, with a head and a foot (so that a part of it is not taken for
the whole). Keys stand without the prefix, values as the server's types, so that neither the prefix, nor the
version nor the flavour of the server need be the same. What only the running service needs (messages, leases,
turns) is left out, and the lists by which jobs are found are made anew from their records: a job that waited
or ran is published again by the reconciler.
"""

from __future__ import annotations

import base64
import gzip
import json
import logging
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

from redis import Redis

from solvers.errors import OndeletteError
from worker.errors import ResultLost
from worker.records import is_job_id
from worker.store import JobStore

logger = logging.getLogger(__name__)

_FORMAT = 1
_JOB = "job:"
_RESULT = ":result"
_TRANSIENT = (
    "active:",
    "deadlines",
    "hooks:tries",
    "index",
    "queued:",
    "rate:",
    "results",
    "running",
    "solve.",
    "turn:",
    "unacked",
    "worker",
    "_kombu",
)
_BATCH = 500


class BackupError(OndeletteError):
    """The file is not a whole backup."""


def write_backup(store: JobStore, path: Path) -> int:
    """Write all keys to ``path``; return how many jobs there are. Nothing is stopped meanwhile.

    Results that are outside of the server are in the file all the same; one that is lost is left out.
    Raises ResultsUnavailable.

    What belongs to one job is read in one step. A job that is added meanwhile may be missing.
    """
    redis, prefix = store.redis, store.prefix
    jobs = keys = 0
    with gzip.open(path, "wt", encoding="utf-8") as file:
        file.write(_line({"ondelette": "backup", "format": _FORMAT, "created_at": time.time()}))
        for name in _names(redis, prefix):
            is_job = name.startswith(_JOB)
            jobs += is_job
            # The record last: with it a job that is put back begins to exist.
            parts = [f"{name}:{part}" for part in ("document", "result", "events")] if is_job else []
            family = [*parts, name]
            for entry in _with_result(store, _read(redis, prefix, family)):
                file.write(_line(entry))
                keys += 1
        file.write(_line({"keys": keys, "jobs": jobs}))
    return jobs


def restore_backup(store: JobStore, path: Path) -> tuple[int, int]:
    """Put a backup back; return how many jobs were put back and how many were there already.

    What is there stays as it is. Raises BackupError before anything is written, and ResultsUnavailable.
    """
    redis, prefix = store.redis, store.prefix
    _check(path)
    restored = present = 0
    for entry in _entries(path):
        name = str(entry["key"])
        job_id = name.split(":")[1] if name.startswith(_JOB) else None
        record = name if job_id is None else _JOB + job_id
        there = bool(redis.exists(prefix + record))
        if not there:
            if job_id is not None and name.endswith(_RESULT):
                packed = store.results_kept.put(job_id, "restored", _bytes(entry["value"]))
                entry |= {"value": _text(packed)}
            _write(redis, prefix + name, entry)
        if job_id is not None and name == record:
            present += there
            restored += not there
            if not there:
                store.relist(job_id)
    return restored, present


def _with_result(store: JobStore, entries: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Put the bytes of a result in the place of a reference to it."""
    for entry in entries:
        if entry["key"].endswith(_RESULT):
            try:
                entry["value"] = _text(store.results_kept.read(_bytes(entry["value"])))
            except ResultLost:
                logger.warning("%s is lost and not in the backup", entry["key"])
                continue
        yield entry


def _names(redis: Redis, prefix: str) -> Iterator[str]:
    pattern = "".join(f"[{letter}]" if letter in "*?[\\" else letter for letter in prefix) + "*"
    for key in redis.scan_iter(match=pattern, count=_BATCH):
        name = cast(bytes, key).decode().removeprefix(prefix)
        part_of_a_job = name.startswith(_JOB) and not is_job_id(name.removeprefix(_JOB))
        if not part_of_a_job and not name.startswith(_TRANSIENT):
            yield name


def _read(redis: Redis, prefix: str, names: list[str]) -> list[dict[str, Any]]:
    """Read keys in one step."""
    types = [cast(bytes, redis.type(prefix + name)).decode() for name in names]
    there = [(name, kind) for name, kind in zip(names, types, strict=True) if kind != "none"]
    with redis.pipeline(transaction=True) as pipe:
        for name, kind in there:
            _READERS[kind](pipe, prefix + name)
            pipe.pttl(prefix + name)
        answers = pipe.execute()
    now = time.time()
    return [
        {
            "key": name,
            "type": kind,
            "value": _text(value),
            "expires_at": now + ttl / 1000 if ttl > 0 else None,
        }
        for (name, kind), value, ttl in zip(there, answers[::2], answers[1::2], strict=True)
        if value
    ]


_READERS: dict[str, Any] = {
    "string": lambda pipe, key: pipe.get(key),
    "hash": lambda pipe, key: pipe.hgetall(key),
    "list": lambda pipe, key: pipe.lrange(key, 0, -1),
    "set": lambda pipe, key: pipe.smembers(key),
    "zset": lambda pipe, key: pipe.zrange(key, 0, -1, withscores=True),
    "stream": lambda pipe, key: pipe.xrange(key),
}


def _write(redis: Redis, key: str, entry: dict[str, Any]) -> None:
    value = _bytes(entry["value"])
    with redis.pipeline(transaction=True) as pipe:
        pipe.delete(key)
        match entry["type"]:
            case "string":
                pipe.set(key, value)
            case "hash":
                pipe.hset(key, mapping=dict(value))
            case "list":
                pipe.rpush(key, *value)
            case "set":
                pipe.sadd(key, *value)
            case "zset":
                pipe.zadd(key, dict(value))
            case "stream":
                for number, fields in value:
                    pipe.xadd(key, dict(fields), id=number)
        if entry["expires_at"] is not None:
            pipe.pexpireat(key, round(1000 * entry["expires_at"]))
        pipe.execute()


def _check(path: Path) -> None:
    """Read the file to its end before anything is written."""
    count, last = 0, dict[str, Any]()
    try:
        for last in _lines(path):
            count += 1
            if count == 1 and (last.get("ondelette"), last.get("format")) != ("backup", _FORMAT):
                raise BackupError(f"{path} is not a backup of this version of ondelette")
    except (OSError, EOFError, ValueError) as error:
        raise BackupError(f"{path} cannot be read as a backup: {error}") from error
    if last.get("keys") != count - 2:
        raise BackupError(f"{path} ends before its end; nothing was restored")


def _entries(path: Path) -> Iterator[dict[str, Any]]:
    return (line for line in _lines(path) if "key" in line)


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    with gzip.open(path, "rt", encoding="utf-8") as file:
        for line in file:
            yield json.loads(line)


def _line(members: dict[str, Any]) -> str:
    return json.dumps(members, separators=(",", ":")) + "\n"


def _text(value: Any) -> Any:
    """Return what JSON can hold: bytes as base64, containers as lists (of pairs)."""
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if isinstance(value, dict):
        return [[_text(key), _text(item)] for key, item in value.items()]
    if isinstance(value, list | tuple | set):
        return [_text(item) for item in value]
    return value


def _bytes(value: Any) -> Any:
    """Return what `_text` was made of, pairs as lists."""
    if isinstance(value, str):
        return base64.b64decode(value)
    if isinstance(value, list):
        return [_bytes(item) for item in value]
    return value
