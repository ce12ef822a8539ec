"""The memory of sweeps: which jobs they consist of, and what came of those that have ended.

A point of a sweep is a job like any other. What is kept besides is a hash of endings, one for each point,
written when its job has ended, by the worker that solved it or by whoever finds it missing. Nothing waits for
all points but their count: a point that ends another way, or whose worker is lost, holds up no other.

Keys: ``sweep:<id>`` (hash: what was asked for), ``sweep:<id>:points`` (the table, compressed JSON),
``sweep:<id>:ends`` (hash: index -> ending),
``sweep:<id>:near`` (list: points solved last, newest first).
"""

from __future__ import annotations

import contextlib
import json
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from redis.client import Pipeline
from redis.exceptions import RedisError

from worker.errors import JobNotFound
from worker.records import DEFAULT_PROJECT, JobError, JobRecord, JobStatus, SweepPlace, is_job_id
from worker.settings import QueueSettings
from worker.store import JobStore
from worker.submitting import batched

_NEAR = 16
_GONE = "gone"

_NOTE = """
-- KEYS = sweep, points, ends, near. ARGV = index, ending, retention, now, channel, id, entry of near or '',
-- how many of these are kept.
if redis.call('EXISTS', KEYS[1]) == 0 then return 0 end
if ARGV[7] ~= '' then
  redis.call('LPUSH', KEYS[4], ARGV[7])
  redis.call('LTRIM', KEYS[4], 0, ARGV[8] - 1)
end
if redis.call('HSETNX', KEYS[3], ARGV[1], ARGV[2]) == 0 then return 0 end
if redis.call('HLEN', KEYS[3]) == tonumber(redis.call('HGET', KEYS[1], 'count')) then
  redis.call('HSET', KEYS[1], 'finished_at', ARGV[4])
  for _, key in ipairs(KEYS) do redis.call('EXPIRE', key, ARGV[3]) end
  redis.call('PUBLISH', ARGV[5], ARGV[6])
end
return 1
"""


@dataclass(frozen=True, slots=True)
class SweepRecord:
    """A sweep as it is remembered; times in seconds since 1970, UTC. ``count`` is its number of points."""

    id: str
    pointers: tuple[str, ...]
    zipped: bool
    count: int
    created_at: float
    name: str | None = None
    finished_at: float | None = None
    project: str = DEFAULT_PROJECT

    def to_hash(self) -> dict[str, str]:
        """Return the record of a new sweep as fields of a Redis hash."""
        fields = {
            "id": self.id,
            "pointers": json.dumps(self.pointers),
            "zipped": str(int(self.zipped)),
            "count": str(self.count),
            "created_at": repr(self.created_at),
            "project": self.project,
        }
        return fields if self.name is None else {**fields, "name": self.name}

    @classmethod
    def from_hash(cls, fields: Mapping[str, str]) -> SweepRecord:
        """Read a record from the fields of its Redis hash."""
        return cls(
            id=fields["id"],
            pointers=tuple(json.loads(fields["pointers"])),
            zipped=fields["zipped"] == "1",
            count=int(fields["count"]),
            created_at=float(fields["created_at"]),
            name=fields.get("name"),
            project=fields["project"],
            finished_at=float(fields["finished_at"]) if "finished_at" in fields else None,
        )


@dataclass(frozen=True, slots=True)
class TableRow:
    """A point of a sweep: its values, its job, where that stands, and its ending once it has one."""

    values: tuple[Any, ...]
    job_id: str
    status: str
    ending: Mapping[str, Any] | None = None


def figures_of(result: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures of a result that a table shows."""
    verification, statistics = result["verification"], result["statistics"]
    names = ("terminal_error", "max_state_error", "max_bound_violation", "max_path_violation", "passed")
    return {
        "success": result["success"],
        "objective": result["objective"],
        "final_time": result["final_time"],
        "verification": {name: verification[name] for name in names},
        "iterations": statistics["iterations"],
        "seconds": statistics["seconds"]["total"],
    }


def ending_of(status: JobStatus, error: JobError | None, figures: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return what a sweep keeps of a job that has ended, with the figures of its result if there is one."""
    return {"status": status.value, "error": None if error is None else error.type.value, **(figures or {})}


class SweepStore:
    """Everything that is remembered of sweeps, beside the store of their jobs. Safe to share.

    Methods that name a sweep raise JobNotFound for an id that nobody knows.
    """

    def __init__(self, store: JobStore, settings: QueueSettings) -> None:
        self._store = store
        self._redis = store.redis
        self._prefix = settings.prefix
        self._retention = settings.retention_seconds
        self._note = cast(Callable[..., Any], self._redis.register_script(_NOTE))

    def add(self, sweep: SweepRecord, jobs: Sequence[tuple[JobRecord, bytes]], values: Sequence[Any]) -> None:
        """Remember a new sweep and all its jobs, in the order of its table.

        Thousands of jobs at once would hold up everybody else for seconds: they are remembered a part at a
        time, and the sweep after the last one. Where that fails there is none, and its jobs are cancelled.
        """
        key, points, *_ = self._keys(sweep.id)
        table = json.dumps([[value, record.id] for value, (record, _) in zip(values, jobs, strict=True)])
        try:
            for part in batched(jobs):
                with self._redis.pipeline(transaction=True) as pipe:
                    for record, document in part:
                        self._store.add_to(pipe, record, document)
                    pipe.execute()
            with self._redis.pipeline(transaction=True) as pipe:
                pipe.hset(key, mapping=cast(Any, sweep.to_hash()))
                pipe.set(points, zlib.compress(table.encode()))
                pipe.execute()
        except RedisError:
            with contextlib.suppress(RedisError):
                self._store.cancel_all([record.id for record, _ in jobs])
            raise

    def exists(self, sweep_id: str) -> bool:
        """Tell whether a sweep is remembered."""
        return bool(self._redis.exists(self._keys(sweep_id)[0]))

    def get(self, sweep_id: str) -> SweepRecord:
        """Return the record of a sweep."""
        fields = cast(dict[bytes, bytes], self._redis.hgetall(self._keys(sweep_id)[0]))
        if not fields:
            raise JobNotFound(sweep_id)
        return SweepRecord.from_hash({name.decode(): value.decode() for name, value in fields.items()})

    def table(self, sweep_id: str) -> list[TableRow]:
        """Return all points; endings that were not noted, for their worker was lost, are noted now."""
        _, points, ends, *_ = self._keys(sweep_id)
        packed = cast(bytes | None, self._redis.get(points))
        if packed is None:
            raise JobNotFound(sweep_id)
        noted = cast(dict[bytes, bytes], self._redis.hgetall(ends))
        endings = {int(index): json.loads(ending) for index, ending in noted.items()}
        rows = [(tuple(values), job_id) for values, job_id in json.loads(zlib.decompress(packed))]
        left = [index for index in range(len(rows)) if index not in endings]
        statuses = dict(zip(left, self._store.statuses([rows[index][1] for index in left]), strict=True))
        missing = [index for index, status in statuses.items() if status is None or status.final]
        endings |= self._note_missing(sweep_id, {index: rows[index][1] for index in missing})
        return [
            TableRow(values, job_id, ending["status"], ending)
            if (ending := endings.get(index)) is not None
            else TableRow(values, job_id, str(statuses[index]))
            for index, (values, job_id) in enumerate(rows)
        ]

    def _note_missing(self, sweep_id: str, missing: Mapping[int, str]) -> dict[int, dict[str, Any]]:
        """Note the endings of jobs by the index of their points; return them."""
        records = self._store.records(list(missing.values()))
        endings = {index: self._ending(record) for index, record in zip(missing, records, strict=True)}
        for part in batched(list(endings.items())):
            with self._redis.pipeline(transaction=False) as pipe:
                for index, ending in part:
                    self.note(SweepPlace(sweep_id, index, ()), ending, client=pipe)
                pipe.execute()
        return endings

    def _ending(self, record: JobRecord | None) -> dict[str, Any]:
        if record is None:
            return {"status": _GONE, "error": None}
        result = self._store.kept_result(record.id) if record.has_result else None
        figures = None if result is None else figures_of(json.loads(result))
        return ending_of(record.status, record.error, figures)

    def note(
        self,
        at: SweepPlace,
        ending: Mapping[str, Any],
        start: str | None = None,
        client: Pipeline | None = None,
    ) -> None:
        """Note how a point has ended; what was noted first stays.

        ``start`` is its job if that has an answer from which its neighbours may start.
        """
        text = json.dumps(ending, allow_nan=False)
        near = "" if start is None else json.dumps([start, at.place])
        told = (self._retention, time.time(), self._store.channel, at.sweep, near, _NEAR)
        self._note(keys=self._keys(at.sweep), args=(at.index, text, *told), client=client)

    def solved_last(self, sweep_id: str) -> list[tuple[str, tuple[float, ...]]]:
        """Return the jobs that were solved last, with their places."""
        entries = cast(list[bytes], self._redis.lrange(self._keys(sweep_id)[3], 0, -1))
        return [(job_id, tuple(place)) for job_id, place in map(json.loads, entries)]

    def cancel(self, sweep_id: str) -> None:
        """Cancel every job that has not ended."""
        self._store.cancel_all([row.job_id for row in self.table(sweep_id) if row.ending is None])

    def _keys(self, sweep_id: str) -> list[str]:
        if not is_job_id(sweep_id):
            raise JobNotFound(sweep_id)
        sweep = f"{self._prefix}sweep:{sweep_id}"
        return [sweep, f"{sweep}:points", f"{sweep}:ends", f"{sweep}:near"]
