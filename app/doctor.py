"""What may be wrong with an installation, looked at from all sides."""

from __future__ import annotations

import platform
import resource
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, cast

from redis import Redis
from redis.exceptions import RedisError

from app.embedded.binary import ServerBinary, find_server
from app.embedded.errors import ServiceStartError
from app.settings import Settings
from worker.blobs import Blobs
from worker.errors import ResultsUnavailable, broker_fault
from worker.keys import KeyStore
from worker.queue import JobQueue
from worker.store import JobStore, connect

Verdict = Literal["ok", "warning", "error"]

_FILES = 1024
_FREE_GIB = 1.0
_SKEW = 2.0
_FULL = 0.8


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    what: str
    verdict: Verdict
    detail: str


def examine(settings: Settings, data: Path | None = None) -> Iterator[Finding]:
    """Look at this machine, the broker and what lives there; ``data`` is the folder of an embedded broker."""
    yield _python()
    yield Finding(
        "packages", "ok", ", ".join(f"{name} {version(name)}" for name in ("ondelette", "casadi", "celery"))
    )
    yield _files()
    if data is not None:
        yield _disk(data)
    yield _results(settings)
    yield _server()
    with connect(settings) as redis:
        try:
            info = cast(dict[str, Any], redis.info())
            began = time.time()
            seconds, microseconds = redis.time()
        except RedisError as error:
            yield Finding("broker", "error", broker_fault(error))
            return
        yield _broker(info)
        yield _skew(seconds + microseconds / 1e6 - began)
        yield _policy(redis)
        yield _persistence(redis, info)
        yield _memory(info)
        yield from _service(redis, settings)


def _python() -> Finding:
    good = sys.version_info >= (3, 11)
    return Finding("python", "ok" if good else "error", platform.python_version())


def _files() -> Finding:
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    detail = f"{soft:,} may be open at a time"
    return Finding("open files", "ok" if soft >= _FILES else "warning", detail)


def _disk(data: Path) -> Finding:
    there = next(folder for folder in (data, *data.resolve().parents) if folder.exists())
    free = shutil.disk_usage(there).free / 2**30
    return Finding("disk", "ok" if free >= _FREE_GIB else "error", f"{free:.1f} GiB free for {data}")


def _results(settings: Settings) -> Finding:
    if settings.results is None:
        return Finding("results", "ok", "in the broker's memory")
    try:
        Blobs(settings.results).probe()
    except ResultsUnavailable as error:
        return Finding("results", "error", str(error))
    return Finding("results", "ok", f"written to {settings.results}")


def _server() -> Finding:
    try:
        binary = find_server()
    except ServiceStartError as error:
        return Finding("server to embed", "warning", str(error))
    detail = binary.warning or f"{binary} at {binary.path}"
    return Finding("server to embed", "ok" if binary.warning is None else "warning", detail)


def _broker(info: dict[str, Any]) -> Finding:
    flavour = "valkey" if "valkey_version" in info else "redis"
    text = str(info.get("valkey_version") or info["redis_version"])
    major, minor, patch = (int(part) for part in text.split(".")[:3])
    warning = ServerBinary(Path("the broker's machine"), flavour, (major, minor, patch)).warning
    return Finding("broker", "ok" if warning is None else "warning", warning or f"{flavour} {text}")


def _skew(seconds: float) -> Finding:
    return Finding("clocks", "ok" if abs(seconds) < _SKEW else "warning", f"{abs(seconds):.2f} s apart")


def _policy(redis: Redis) -> Finding:
    policy = _configured(redis, "maxmemory-policy")
    if policy is None:
        return Finding("eviction", "warning", "the broker does not tell; it must be noeviction")
    detail = policy if policy == "noeviction" else f"{policy}: a full broker forgets jobs; set noeviction"
    return Finding("eviction", "ok" if policy == "noeviction" else "error", detail)


def _persistence(redis: Redis, info: dict[str, Any]) -> Finding:
    if not info.get("aof_enabled"):
        return Finding("persistence", "error", "no append-only file: a restart of the broker loses jobs")
    if info.get("aof_last_write_status") != "ok":
        return Finding("persistence", "error", "the last write of the append-only file failed")
    return Finding(
        "persistence", "ok", f"append-only file, synced {_configured(redis, 'appendfsync') or '?'}"
    )


def _memory(info: dict[str, Any]) -> Finding:
    used, most = info["used_memory"], info.get("maxmemory", 0)
    if not most:
        return Finding("memory", "ok", f"{used / 2**20:.0f} MiB used, no limit")
    detail = f"{used / 2**20:.0f} of {most / 2**20:.0f} MiB used"
    return Finding("memory", "ok" if used < _FULL * most else "warning", detail)


def _service(redis: Redis, settings: Settings) -> Iterator[Finding]:
    workers = JobQueue(redis, settings).workers()
    slots = sum(workers.values())
    detail = f"{len(workers)} alive, {slots} jobs at a time" if workers else "none is alive: jobs wait"
    yield Finding("workers", "ok" if workers else "error", detail)
    counts = JobStore(redis, settings).counts()
    detail = f"{sum(counts.queued.values())} wait, the oldest for {counts.oldest:.0f} s; {counts.running} run"
    yield Finding("jobs", "ok", detail)
    keys = KeyStore(redis, settings).list()
    valid = sum(key.valid(time.time()) for key in keys)
    none = "none: the service listens to its own machine only"
    yield Finding("keys", "ok", f"{valid} valid of {len(keys)}" if keys else none)


def _configured(redis: Redis, name: str) -> str | None:
    """A setting of the broker, None where it may not be asked for (an ACL, a service of a provider)."""
    ask = cast(Callable[[str], dict[str, str]], redis.config_get)
    try:
        return ask(name).get(name)
    except RedisError:
        return None
