"""The side of the store that whoever submits jobs and asks for them sees."""

from __future__ import annotations

import json
import logging
import secrets
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar, cast

from redis.client import Pipeline

from worker.counts import Counts
from worker.errors import JobActive, JobGone, JobNotFound, ResultLost
from worker.keyspace import Keyspace, record_of
from worker.records import FIRST, JobEvent, JobRecord, JobStatus, Priority
from worker.results import LONGEST_REFERENCE

logger = logging.getLogger(__name__)

_COMPRESSION = 3
_SCAN = 100
_SCANS_PER_PAGE = 20
_COUNTED_AT_ONCE = 1_000
_AT_ONCE = 250

T = TypeVar("T")


class Submitting(Keyspace):
    """Jobs added, found, listed, cancelled, kept and erased."""

    def add(
        self,
        record: JobRecord,
        document: bytes,
        publication: tuple[str, bytes] | None = None,
        most: tuple[int, int] | None = None,
    ) -> bool:
        """Remember a new job and its ``document``, the JSON text as it was submitted; all in one step.

        ``publication`` is its message and where that waits (`JobQueue.publication`); without it the job is to
        be published afterwards. False, and nothing is done, where ``most[0]`` jobs of the project are active
        by its register, which may count some that have ended (see `active`), or ``most[1]`` of all projects
        wait. A job that is remembered already stays as it is.
        """
        return bool(self._add_by(None, record, document, publication, most))

    def add_to(self, pipe: Pipeline, record: JobRecord, document: bytes) -> None:
        """Make what `add` does, but for the publication, part of a transaction."""
        self._add_by(pipe, record, document, None, None)

    def _add_by(
        self,
        client: Pipeline | None,
        record: JobRecord,
        document: bytes,
        publication: tuple[str, bytes] | None,
        most: tuple[int, int] | None,
    ) -> Any:
        project = record.project
        registers = (self._index, self._index_of(project), self._active_of(project), self._projects)
        where, message = (None, b"") if publication is None else publication
        fields = [word for field in record.to_hash().items() for word in field]
        return self._run(
            self._add,
            record.id,
            zlib.compress(document, _COMPRESSION),
            json.dumps(_first_status(record)),
            message,
            *(("", "") if most is None else most),
            *fields,
            keys=[*registers, self.hooks.due, *([] if where is None else [where])],
            client=client,
        )

    def exists(self, job_id: str) -> bool:
        """Tell whether a job is remembered."""
        return bool(self.redis.exists(self._keys(job_id)[0]))

    def project(self, job_id: str) -> str:
        """Return the project of a job, also of one that was erased or has outlived its retention."""
        job, _, _, tombstone = self._keys(job_id)
        with self.redis.pipeline(transaction=False) as pipe:
            pipe.hget(job, "project")
            pipe.get(tombstone)
            project, buried = pipe.execute()
        if project is None and buried is None:
            raise JobNotFound(job_id)
        return str((buried if project is None else project).decode())

    def active(self, project: str, limit: int) -> int:
        """Return how many jobs of a project wait or run; exact where these are at least ``limit``."""
        register = self._active_of(project)
        count = self.redis.scard(register)
        if count < limit or (count > _COUNTED_AT_ONCE and not self.take_turn(f"active:{project}", 0.5)):
            return count
        members = [job_id.decode() for job_id in cast(set[bytes], self.redis.smembers(register))]
        ended = [
            job_id
            for job_id, status in zip(members, self.statuses(members), strict=True)
            if status is None or status.final
        ]
        return count - (self.redis.srem(register, *ended) if ended else 0)

    def burden(self, project: str, limit: int) -> tuple[int, int]:
        """Return how many jobs of a project wait or run (see `active`), and how many of all projects wait."""
        with self.redis.pipeline(transaction=False) as pipe:
            pipe.scard(self._active_of(project))
            for register in self._queued.values():
                pipe.zcard(register)
            count, *waiting = pipe.execute()
        return (count if count < limit else self.active(project, limit)), sum(waiting)

    def statuses(self, job_ids: Sequence[str]) -> list[JobStatus | None]:
        """Return the status of each job, None for one that is not remembered."""
        with self.redis.pipeline(transaction=False) as pipe:
            for job_id in job_ids:
                pipe.hget(self._keys(job_id)[0], "status")
            answers = pipe.execute() if job_ids else []
        return [None if answer is None else JobStatus(answer.decode()) for answer in answers]

    def records(self, job_ids: Sequence[str]) -> list[JobRecord | None]:
        """Return the record of each job, None for one that is not remembered."""
        hashes: list[dict[bytes, bytes]] = []
        for part in batched(job_ids):
            with self.redis.pipeline(transaction=False) as pipe:
                for job_id in part:
                    pipe.hgetall(self._keys(job_id)[0])
                hashes += pipe.execute()
        return [record_of(fields) if fields else None for fields in hashes]

    def document(self, job_id: str) -> bytes:
        """Return the JSON text of a job's document as it was submitted."""
        packed = cast(bytes | None, self.redis.get(self._keys(job_id)[1]))
        if packed is None:
            self.get(job_id)
            raise JobGone(job_id)
        return zlib.decompress(packed)

    def result(self, job_id: str) -> bytes | None:
        """Return the JSON text of a job's result, None while or where there is none.

        Raises ResultLost where there was one, and ResultsUnavailable.
        """
        both = self.result_twice(job_id)
        return None if both is None else both[1]

    def result_twice(self, job_id: str) -> tuple[bytes, bytes] | None:
        """Return what `result` does, compressed as `compress` does it, and as it is."""
        stored = cast(bytes | None, self.redis.get(self._keys(job_id)[2]))
        if stored is None:
            if self.get(job_id).has_result:
                raise ResultLost(job_id)
            return None
        return self.results_kept.both(stored)

    def kept_result(self, job_id: str) -> bytes | None:
        """Return the JSON text of a job's result, None where there is none, or none any more.

        Raises ResultsUnavailable.
        """
        try:
            packed = cast(bytes | None, self.redis.get(self._keys(job_id)[2]))
            return None if packed is None else self.results_kept.unpack(packed)
        except JobNotFound:
            return None
        except ResultLost:
            logger.warning("job %s: its result is lost", job_id)
            return None

    def events(self, job_id: str, after: str = FIRST) -> list[JobEvent]:
        """Return what happened to a job behind the event ``after``, oldest first; some 1,000 are kept."""
        entries = cast(
            list[tuple[bytes, dict[bytes, bytes]]], self.redis.xrange(self._stream(job_id), f"({after}")
        )
        return [
            JobEvent(number.decode(), fields[b"event"].decode(), json.loads(fields[b"data"]))
            for number, fields in entries
        ]

    def cancel(self, job_id: str) -> JobRecord:
        """End a queued job, ask a running one to stop, leave an ended one as it is; return the record."""
        self._run(self._cancel, job_id)
        return self.get(job_id)

    def cancel_all(self, job_ids: Sequence[str]) -> None:
        """Do what `cancel` does to many jobs; those that are not remembered are passed over."""
        for part in batched(job_ids):
            with self.redis.pipeline(transaction=False) as pipe:
                for job_id in part:
                    self._run(self._cancel, job_id, client=pipe)
                pipe.execute()

    def answered(self, project: str, digest: str) -> str | None:
        """Return the job of a project that this version of the solvers answered last by ``digest``, or None.

        It may not be kept any more.
        """
        job_id = cast(bytes | None, self.redis.get(self._answer_to(digest) + project))
        return None if job_id is None else job_id.decode()

    def answer(self, job_id: str, earlier: str, result: bytes) -> bool:
        """End a waiting job with the ``result`` (JSON) of an ``earlier`` one; False if it does not wait."""
        packed = compress(result)
        stored = self.results_kept.put(job_id, secrets.token_hex(16), packed)
        if self._run(self._answer, job_id, earlier, stored, len(packed)):
            return True
        self._drop_unused(job_id, stored)
        return False

    def pin(self, job_id: str, *, pinned: bool) -> JobRecord:
        """Keep a job until it is erased, or for its time from now on; return the record."""
        self._run(self._pin, job_id, int(pinned))
        return self.get(job_id)

    def erase(self, job_id: str) -> None:
        """Erase an ended job; raises JobActive for any other."""
        # As much of it as may be a reference to where it is.
        stored = cast(bytes, self.redis.getrange(self._keys(job_id)[2], 0, LONGEST_REFERENCE - 1))
        answer = self._run(self._erase, job_id, keys=[self._index])
        if answer is None:
            self.get(job_id)
        elif answer != b"erased":
            raise JobActive(job_id)
        else:
            self.results_kept.drop(stored)

    def page(
        self,
        limit: int,
        after: str | None = None,
        wanted: Callable[[JobRecord], bool] = lambda record: True,
        project: str | None = None,
    ) -> tuple[list[JobRecord], str | None]:
        """List jobs, newest first: at most ``limit`` of those ``wanted``, from behind the id ``after``.

        All jobs, or those of one ``project``.

        Returns the records and the id behind which to go on, None at the end. A page may hold fewer than
        ``limit`` records and still not be the last: one call looks at a bounded number of jobs.
        """
        found: list[JobRecord] = []
        index = self._index if project is None else self._index_of(project)
        top = "+" if after is None else f"({after}"
        for _ in range(_SCANS_PER_PAGE):
            ids = cast(list[bytes], self.redis.zrevrangebylex(index, top, "-", start=0, num=_SCAN))
            records = self._still_there([job_id.decode() for job_id in ids], index)
            for record in filter(wanted, records):
                if len(found) == limit:
                    return found, found[-1].id
                found.append(record)
            if len(ids) < _SCAN:
                return found, None
            after = ids[-1].decode()
            top = f"({after}"
        return found, after

    def _still_there(self, job_ids: Sequence[str], index: str) -> list[JobRecord]:
        """Return the records of those jobs that are remembered, and take the others off an ``index``."""
        found = dict(zip(job_ids, self.records(job_ids), strict=True))
        expired = [job_id for job_id, record in found.items() if record is None]
        if expired:
            self.redis.zrem(index, *expired)
        return [record for record in found.values() if record is not None]

    def counts(self) -> Counts:
        """Return the numbers over all jobs."""
        with self.redis.pipeline(transaction=True) as pipe:
            pipe.hgetall(self._counts)
            pipe.zcard(self._running)
            for register in self._queued.values():
                pipe.zcard(register)
                pipe.zrange(register, 0, 0, withscores=True)
            totals, running, *queued = pipe.execute()
        now = time.time()
        age = max((now - oldest[0][1] for oldest in queued[1::2] if oldest), default=0.0)
        numbers = {name.decode(): float(number) for name, number in totals.items()}
        return Counts(dict(zip(Priority, queued[::2], strict=True)), running, max(0.0, age), numbers)


def batched(items: Sequence[T]) -> Iterator[Sequence[T]]:
    """Iterate over parts that a server does at once without holding up others for long."""
    return (items[start : start + _AT_ONCE] for start in range(0, len(items), _AT_ONCE))


def _first_status(record: JobRecord) -> dict[str, Any]:
    return {
        "status": record.status,
        "attempts": 0,
        "cancel_requested": False,
        "error": None,
        "at": record.created_at,
    }


def compress(result: bytes) -> bytes:
    """Compress the JSON text of a result as the store keeps it (zlib, RFC 1950)."""
    return zlib.compress(result, _COMPRESSION)
