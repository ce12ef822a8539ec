"""The memory of the service: job records, documents, progress and results in Redis.

The record is the truth about a job; messages of the queue only say that there is something to do. Every
change of status is one script (`worker.scripts`), so that two processes never see or make half a change.
"""

from __future__ import annotations

import json
import math
import secrets
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from enum import StrEnum
from importlib.metadata import version
from typing import Any, cast

from redis import Redis
from redis.backoff import ExponentialBackoff
from redis.client import Pipeline
from redis.retry import Retry

from solvers.progress import ProgressReport
from worker import scripts
from worker.address import redis_url
from worker.counts import Counts
from worker.errors import JobActive, JobGone, JobNotFound
from worker.hooks import HookList
from worker.records import (
    FIRST,
    FailureType,
    JobError,
    JobEvent,
    JobRecord,
    JobStatus,
    Priority,
    is_job_id,
)
from worker.settings import QueueSettings

MAX_LOSSES = 2
"""Workers that a job may lose before it is given up."""

_COMPRESSION = 3
_MEMORY = 30 * 86_400
_SCAN = 100
_SCANS_PER_PAGE = 20
_COUNTED_AT_ONCE = 1_000

_GIVEN_UP = JobError(
    FailureType.WORKER_LOST,
    "The worker was lost.",
    f"The job was started {MAX_LOSSES} times and its worker ended without a word each time; it is not tried "
    "again. A smaller problem may go through; the worker's log tells why it ended.",
)


_LATE = JobError(
    FailureType.TIME_LIMIT,
    "The deadline passed.",
    "The time of deadline_seconds was over before the job could be solved.",
)


def new_owner(solver: str = "") -> str:
    """Return a new word for the owner of a job; ``solver`` says whose it is (see `solver_of`)."""
    return solver + secrets.token_hex(16)


def solver_of(worker: str | None, pid: int | str | None = None) -> str:
    """Return how the words begin by which ``worker``, or only its child ``pid``, owns jobs."""
    return f"{worker}/" if pid is None else f"{worker}/{pid}/"


class Signal(StrEnum):
    """What a running solve hears when it writes its progress."""

    GO = "go"
    CANCEL = "cancel"
    LOST = "lost"


def connect(settings: QueueSettings, retries: int = 1, timeout: float = 5.0) -> Redis:
    """Return a client that waits ``timeout`` seconds for an answer.

    It tries a failed command ``retries`` times more, after 0.1 s, doubling to 2 s.
    """
    return Redis.from_url(
        redis_url(settings.broker),
        socket_timeout=timeout,
        socket_connect_timeout=2.0,
        health_check_interval=25,
        retry=Retry(ExponentialBackoff(cap=2.0, base=0.1), retries),
    )


class JobStore:
    """Everything that is remembered of jobs. Safe to share between threads and to use after a fork.

    Methods that name a job raise JobNotFound for an id that nobody knows and JobGone for one that was erased
    or has outlived its retention; all raise redis.exceptions.RedisError where the server does not answer.
    """

    def __init__(self, redis: Redis, settings: QueueSettings) -> None:
        self.redis = redis
        self.channel = f"{settings.prefix}status"
        """Channel on which every event of a job is published as ``<id> <event>``."""
        self.hooks = HookList(redis, settings)
        self._prefix = settings.prefix
        self._index = f"{settings.prefix}index"
        self._queued = {priority: f"{settings.prefix}queued:{priority}" for priority in Priority}
        self._deadlines = f"{settings.prefix}deadlines"
        self._projects = f"{settings.prefix}projects"
        self._running = f"{settings.prefix}running"
        self._counts = f"{settings.prefix}counts"
        self._unacked = f"{settings.prefix}unacked_index"
        self._lease = settings.lease_seconds
        self._retention = settings.retention_seconds
        self._start = self._script(scripts.START)
        self._report = self._script(scripts.REPORT)
        self._finish = self._script(scripts.FINISH)
        self._fail = self._script(scripts.FAIL)
        self._lose = self._script(scripts.LOSE)
        self._renew = self._script(scripts.RENEW)
        self._reclaim = self._script(scripts.RECLAIM)
        self._hand_back = self._script(scripts.HAND_BACK)
        self._give_up = self._script(scripts.GIVE_UP)
        self._cancel = self._script(scripts.CANCEL)
        self._pin = self._script(scripts.PIN)
        self._erase = self._script(scripts.ERASE)
        self._answer = self._script(scripts.ANSWER)

    # The side of the submitter.

    def add(self, record: JobRecord, document: bytes) -> None:
        """Remember a new job and its ``document``, the JSON text as it was submitted."""
        with self.redis.pipeline(transaction=True) as pipe:
            self.add_to(pipe, record, document)
            pipe.execute()

    def add_to(self, pipe: Pipeline, record: JobRecord, document: bytes) -> None:
        """Make what `add` does part of a transaction."""
        job, body, *_ = self._keys(record.id)
        pipe.hset(job, mapping=cast(Any, record.to_hash()))
        pipe.set(body, zlib.compress(document, _COMPRESSION))
        pipe.zadd(self._index, {record.id: 0})
        pipe.zadd(self._index_of(record.project), {record.id: 0})
        pipe.sadd(self._active_of(record.project), record.id)
        pipe.sadd(self._projects, record.project)
        pipe.zadd(self._queued[record.priority], {record.id: record.created_at})
        if record.webhook is not None:
            self.hooks.add_to(pipe, record.id)
        if record.deadline_at is not None:
            pipe.zadd(self._deadlines, {record.id: record.deadline_at})
        pipe.xadd(self._stream(record.id), _first_event(record))

    def discard(self, record: JobRecord) -> None:
        """Forget a job that could not be queued, without a trace: its id was never told to anybody."""
        job_id, project = record.id, record.project
        with self.redis.pipeline(transaction=True) as pipe:
            pipe.delete(*self._keys(job_id), self._stream(job_id))
            pipe.srem(self._active_of(project), job_id)
            for register in (
                self._index,
                self._index_of(project),
                *self._queued.values(),
                self._running,
                self._deadlines,
            ):
                pipe.zrem(register, job_id)
            pipe.execute()

    def get(self, job_id: str) -> JobRecord:
        """Return the record of a job."""
        job, _, _, tombstone = self._keys(job_id)
        with self.redis.pipeline(transaction=False) as pipe:
            pipe.hgetall(job)
            pipe.exists(tombstone)
            fields, known = pipe.execute()
        if fields:
            return _record(fields)
        raise JobGone(job_id) if known else JobNotFound(job_id)

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

    def waiting(self) -> int:
        """Return how many jobs wait."""
        with self.redis.pipeline(transaction=False) as pipe:
            for register in self._queued.values():
                pipe.zcard(register)
            return sum(pipe.execute())

    def statuses(self, job_ids: Sequence[str]) -> list[JobStatus | None]:
        """Return the status of each job, None for one that is not remembered."""
        with self.redis.pipeline(transaction=False) as pipe:
            for job_id in job_ids:
                pipe.hget(self._keys(job_id)[0], "status")
            answers = pipe.execute() if job_ids else []
        return [None if answer is None else JobStatus(answer.decode()) for answer in answers]

    def document(self, job_id: str) -> bytes:
        """Return the JSON text of a job's document as it was submitted."""
        packed = cast(bytes | None, self.redis.get(self._keys(job_id)[1]))
        if packed is None:
            self.get(job_id)
            raise JobGone(job_id)
        return zlib.decompress(packed)

    def result(self, job_id: str) -> bytes | None:
        """Return the JSON text of a job's result, None while or where there is none."""
        packed = cast(bytes | None, self.redis.get(self._keys(job_id)[2]))
        if packed is None:
            self.get(job_id)
            return None
        return zlib.decompress(packed)

    def results(self, job_ids: Sequence[str]) -> Iterator[bytes | None]:
        """Iterate over the JSON texts of results, None for a job that has none or is not remembered."""
        for job_id in job_ids:
            packed = cast(bytes | None, self.redis.get(self._keys(job_id)[2]))
            yield None if packed is None else zlib.decompress(packed)

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

    def answered(self, digest: str) -> str | None:
        """Return the job that this version of the solvers answered last by ``digest``, None if there is none.

        It may not be kept any more.
        """
        job_id = cast(bytes | None, self.redis.get(self._answer_to(digest)))
        return None if job_id is None else job_id.decode()

    def answer(self, job_id: str, earlier: str, result: bytes) -> bool:
        """End a waiting job with the ``result`` (JSON) of an ``earlier`` one; False if it does not wait."""
        return bool(self._run(self._answer, job_id, earlier, compress(result)))

    def pin(self, job_id: str, *, pinned: bool) -> JobRecord:
        """Keep a job until it is erased, or for its time from now on; return the record."""
        self._run(self._pin, job_id, int(pinned))
        return self.get(job_id)

    def erase(self, job_id: str) -> None:
        """Erase an ended job; raises JobActive for any other."""
        answer = self._run(self._erase, job_id, keys=[self._index])
        if answer is None:
            self.get(job_id)
        elif answer != b"erased":
            raise JobActive(job_id)

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
            records = self._records(ids, index)
            for record in filter(wanted, records):
                if len(found) == limit:
                    return found, found[-1].id
                found.append(record)
            if len(ids) < _SCAN:
                return found, None
            after = ids[-1].decode()
            top = f"({after}"
        return found, after

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

    # The side of the worker.

    def start(self, job_id: str, owner: str = "", *, redelivered: bool = False) -> str | None:
        """Make a job running; return the word by which its solve owns it, None if there is nothing to solve.

        ``owner`` is a word of `new_owner`; a start that was asked before with the same word is confirmed.
        ``redelivered`` is only counted.
        There is nothing to do for a job that has ended, that is not remembered, that another solve owns,
        that has now lost its worker for the second time (it then ends as failed/worker_lost), or whose
        deadline has passed (failed/time_limit).
        """
        owner = owner or new_owner()
        lost, late = _GIVEN_UP.to_json(), _LATE.to_json()
        answer = self._run(self._start, job_id, owner, MAX_LOSSES, lost, int(redelivered), late)
        return owner if answer == b"started" else None

    def seconds_left(self, job_id: str) -> float:
        """Return how long a solve of a job may take that starts now: until its limit or its deadline."""
        record = self.get(job_id)
        until_deadline = math.inf if record.deadline_at is None else record.deadline_at - time.time()
        return max(0.0, min(record.max_seconds, until_deadline))

    def report(self, job_id: str, owner: str, report: ProgressReport | None) -> Signal:
        """Write the progress of a running job (None: nothing new) and hear whether to go on.

        A trajectory is told as an event and not kept in the record.
        """
        text = told = ""
        if report is not None:
            members = _finite(asdict(report))
            trajectory = members.pop("trajectory")
            text = json.dumps(members)
            told = text if trajectory is None else json.dumps({**members, "trajectory": trajectory})
        answer = self._run(self._report, job_id, owner, text, told)
        return Signal(cast(bytes, answer).decode())

    def finish(
        self,
        job_id: str,
        owner: str,
        status: JobStatus,
        error: JobError | None = None,
        result: bytes | None = None,
        digest: str | None = None,
    ) -> bool:
        """Write the end of a job, with its ``result`` as `compress` made it.

        By ``digest``, that of what it answers, it is found by `answered`. Returns False, and writes nothing,
        if the job is not running or is owned by another solve.
        """
        if not status.final:
            raise ValueError(f"{status} is not a final status")
        failure = "" if error is None else error.to_json()
        keys = [] if digest is None else [self._answer_to(digest)]
        words = (owner, status.value, failure, result or b"")
        return bool(self._run(self._finish, job_id, *words, keys=keys))

    # The side of a worker's main process, which knows of its children's words only how they begin.

    def fail(self, job_id: str, error: JobError, solver: str = "") -> bool:
        """End a running job whose solve cannot speak for itself; False if ``solver`` does not own it."""
        return bool(self._run(self._fail, job_id, solver, error.to_json()))

    def lose(self, job_id: str, solver: str, grace: float, error: JobError) -> bool:
        """Note that ``solver`` has died, so that the job may be started anew; False if it does not own it.

        One that had more than ``grace`` seconds beyond the job's ``max_seconds`` died of that: the job ends
        with ``error``.
        """
        return bool(self._run(self._lose, job_id, solver, grace, error.to_json()))

    def hand_back(self, job_id: str, solver: str = "") -> bool:
        """Put a running job back to queued, as its worker shuts down; False if ``solver`` does not own it."""
        return bool(self._run(self._hand_back, job_id, solver))

    def renew(self, held: Sequence[tuple[str, str, str]]) -> None:
        """Renew the leases of all messages that a worker holds: for each job id, delivery tag and solver."""
        if held:
            keys = [
                self._unacked,
                self._running,
                self._counts,
                *(self._keys(job_id)[0] for job_id, _, _ in held),
            ]
            self._renew(keys=keys, args=[self._lease, *(word for words in held for word in words)])

    # The side of the reconciler.

    def take_turn(self, task: str, seconds: float) -> bool:
        """Tell whether this process is the one that does ``task`` during the next ``seconds``."""
        return bool(
            self.redis.set(f"{self._prefix}turn:{task}", "", nx=True, px=max(1, round(1000 * seconds)))
        )

    def queued_before(self, priority: Priority, moment: float, limit: int) -> list[str]:
        """List jobs of a priority that were published before ``moment`` and wait since, longest first."""
        return self._listed(self._queued[priority], moment, limit)

    def silent(self, seconds: float, limit: int) -> list[str]:
        """List running jobs whose lease has been over for ``seconds``."""
        now, _ = self.redis.time()
        return self._listed(self._running, now - seconds, limit)

    def published(self, record: JobRecord) -> None:
        """Note that a waiting job was published again just now."""
        with self.redis.pipeline(transaction=True) as pipe:
            pipe.zadd(self._queued[record.priority], {record.id: time.time()}, xx=True)
            pipe.hincrby(self._counts, "republished", 1)
            pipe.execute()

    def unlist(self, job_id: str) -> None:
        """Take a job that does not wait off the lists of those that do."""
        with self.redis.pipeline(transaction=True) as pipe:
            for register in self._queued.values():
                pipe.zrem(register, job_id)
            pipe.execute()

    def give_up_overdue(self, limit: int) -> int:
        """End waiting jobs whose deadline has passed; return how many."""
        late = self._listed(self._deadlines, time.time(), limit)
        return sum(bool(self._run(self._give_up, job_id, _LATE.to_json())) for job_id in late)

    def reclaim(self, job_id: str) -> bool:
        """Take a job from a solve that is lost; True if it waits again and is to be published."""
        return bool(self._run(self._reclaim, job_id, MAX_LOSSES, _GIVEN_UP.to_json()))

    def relist(self, job_id: str) -> None:
        """List a job that was put back from a backup; one that waited or ran waits again."""
        record = self.get(job_id)
        with self.redis.pipeline(transaction=True) as pipe:
            pipe.zadd(self._index, {job_id: 0})
            pipe.zadd(self._index_of(record.project), {job_id: 0})
            pipe.sadd(self._projects, record.project)
            if not record.status.final:
                job = self._keys(job_id)[0]
                pipe.hset(job, "status", JobStatus.QUEUED.value)
                pipe.hdel(job, "owner", "started_at", "progress")
                pipe.hincrby(job, "version", 1)
                pipe.sadd(self._active_of(record.project), job_id)
                pipe.zadd(self._queued[record.priority], {job_id: record.created_at})
                if record.deadline_at is not None:
                    pipe.zadd(self._deadlines, {job_id: record.deadline_at})
            pipe.execute()

    def tidy(self, limit: int) -> int:
        """Drop those of the ``limit`` oldest entries of the list of jobs whose time of keeping has passed."""
        projects = cast(set[bytes], self.redis.smembers(self._projects))
        dropped = 0
        for index in (self._index, *(self._index_of(name.decode()) for name in projects)):
            ids = cast(list[bytes], self.redis.zrangebylex(index, "-", "+", start=0, num=limit))
            dropped += len(ids) - len(self._records(ids, index))
        return dropped

    # Inside.

    def _listed(self, register: str, moment: float, limit: int) -> list[str]:
        found = self.redis.zrangebyscore(register, "-inf", f"({moment!r}", start=0, num=limit)
        return [job_id.decode() for job_id in cast(list[bytes], found)]

    def _keys(self, job_id: str) -> list[str]:
        # Whatever else somebody asks for is no job, and must not become part of a key.
        if not is_job_id(job_id):
            raise JobNotFound(job_id)
        job = f"{self._prefix}job:{job_id}"
        return [job, f"{job}:document", f"{job}:result", f"{self._prefix}gone:{job_id}"]

    def _answer_to(self, digest: str) -> str:
        return f"{self._prefix}answer:{version('ondelette')}:{digest}"

    def _stream(self, job_id: str) -> str:
        return f"{self._keys(job_id)[0]}:events"

    def _script(self, text: str) -> Callable[..., Any]:
        return cast(Callable[..., Any], self.redis.register_script(text))

    def _run(
        self, script: Callable[..., Any], job_id: str, *args: str | float | bytes, keys: Sequence[str] = ()
    ) -> bytes | int | None:
        common = (job_id, self.channel, repr(time.time()), self._retention, _MEMORY, self._lease)
        ours = (
            *self._keys(job_id),
            self._running,
            self._stream(job_id),
            self._counts,
            self._deadlines,
            *self._queued.values(),
        )
        return cast(bytes | int | None, script(keys=[*ours, *keys], args=[*common, *args]))

    def _index_of(self, project: str) -> str:
        return f"{self._index}:{project}"

    def _active_of(self, project: str) -> str:
        return f"{self._prefix}active:{project}"

    def _records(self, ids: Sequence[bytes], index: str) -> list[JobRecord]:
        with self.redis.pipeline(transaction=False) as pipe:
            for job_id in ids:
                pipe.hgetall(self._keys(job_id.decode())[0])
            hashes = pipe.execute() if ids else []
        expired = [job_id for job_id, fields in zip(ids, hashes, strict=True) if not fields]
        if expired:
            self.redis.zrem(index, *expired)
        return [_record(fields) for fields in hashes if fields]


def _first_event(record: JobRecord) -> dict[Any, Any]:
    data = {
        "status": record.status,
        "attempts": 0,
        "cancel_requested": False,
        "error": None,
        "at": record.created_at,
    }
    return {"event": "status", "data": json.dumps(data)}


def compress(result: bytes) -> bytes:
    """Compress the JSON text of a result as the store keeps it (zlib, RFC 1950)."""
    return zlib.compress(result, _COMPRESSION)


def _record(fields: dict[bytes, bytes]) -> JobRecord:
    return JobRecord.from_hash({key.decode(): value.decode() for key, value in fields.items()})


def _finite(report: dict[str, Any]) -> dict[str, Any]:
    """Replace the infinities of a first iterate by None: JSON has no word for them."""
    return {
        key: None if isinstance(value, float) and not abs(value) < float("inf") else value
        for key, value in report.items()
    }
