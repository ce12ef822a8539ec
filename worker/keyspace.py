"""Where jobs are in Redis, and how one script changes all of a job at once.

The record is the truth about a job; messages of the queue only say that there is something to do. Every
change of status is one script (`worker.scripts`), so that two processes never see or make half a change.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any, cast

from redis import Redis
from redis.client import Pipeline

from worker.errors import JobGone, JobNotFound
from worker.hooks import HookList
from worker.records import JobRecord, Priority, is_job_id
from worker.results import Results
from worker.scripts import caring, solving, submitting
from worker.settings import QueueSettings

_MEMORY = 30 * 86_400
# Read once: it takes as long as three exchanges with the server.
_VERSION = version("ondelette")


class Keyspace:
    """Keys, registers and scripts of one service; what each side of the store builds upon."""

    def __init__(self, redis: Redis, settings: QueueSettings) -> None:
        self.redis = redis
        self.channel = f"{settings.prefix}ends"
        """Channel of ends: ``<id> <record>``, which `record_told` reads; of a sweep ``<id>`` alone."""
        self.hooks = HookList(redis, settings)
        self.results_kept = Results(redis, settings)
        """What stands under the result's key of a job, packed and unpacked."""
        self.prefix = settings.prefix
        """How every key begins."""
        self._index = f"{settings.prefix}index"
        self._queued = {priority: f"{settings.prefix}queued:{priority}" for priority in Priority}
        self._deadlines = f"{settings.prefix}deadlines"
        self._projects = f"{settings.prefix}projects"
        self._running = f"{settings.prefix}running"
        self._counts = f"{settings.prefix}counts"
        self._unacked = f"{settings.prefix}unacked_index"
        self._lease = settings.lease_seconds
        self._retention = settings.retention_seconds
        self._add = self._script(submitting.ADD)
        self._start = self._script(solving.START)
        self._report = self._script(solving.REPORT)
        self._finish = self._script(solving.FINISH)
        self._fail = self._script(solving.FAIL)
        self._lose = self._script(solving.LOSE)
        self._renew = self._script(solving.RENEW)
        self._reclaim = self._script(caring.RECLAIM)
        self._hand_back = self._script(solving.HAND_BACK)
        self._give_up = self._script(caring.GIVE_UP)
        self._cancel = self._script(submitting.CANCEL)
        self._pin = self._script(submitting.PIN)
        self._erase = self._script(submitting.ERASE)
        self._answer = self._script(submitting.ANSWER)

    def channel_of(self, job_id: str) -> str:
        """Return the channel by which those who follow a job hear, without a word, that it has changed."""
        return f"{self.channel}:{job_id}"

    def get(self, job_id: str) -> JobRecord:
        """Return the record of a job."""
        job, _, _, tombstone = self._keys(job_id)
        with self.redis.pipeline(transaction=False) as pipe:
            pipe.hgetall(job)
            pipe.exists(tombstone)
            fields, known = pipe.execute()
        if fields:
            return record_of(fields)
        raise JobGone(job_id) if known else JobNotFound(job_id)

    def take_turn(self, task: str, seconds: float) -> bool:
        """Tell whether this process is the one that does ``task`` during the next ``seconds``."""
        return bool(
            self.redis.set(f"{self.prefix}turn:{task}", "", nx=True, px=max(1, round(1000 * seconds)))
        )

    def _drop_unused(self, job_id: str, stored: bytes) -> None:
        """Let go of a result that was not written, unless it was and only the answer was lost on the way."""
        if self.redis.get(self._keys(job_id)[2]) != stored:
            self.results_kept.drop(stored)

    def _listed(self, register: str, moment: float, limit: int) -> list[str]:
        found = self.redis.zrangebyscore(register, "-inf", f"({moment!r}", start=0, num=limit)
        return [job_id.decode() for job_id in cast(list[bytes], found)]

    def _keys(self, job_id: str) -> list[str]:
        # Whatever else somebody asks for is no job, and must not become part of a key.
        if not is_job_id(job_id):
            raise JobNotFound(job_id)
        job = f"{self.prefix}job:{job_id}"
        return [job, f"{job}:document", f"{job}:result", f"{self.prefix}gone:{job_id}"]

    def _answer_to(self, digest: str) -> str:
        # The project follows: no job is answered by one of another.
        return f"{self.prefix}answer:{_VERSION}:{digest}:"

    def _stream(self, job_id: str) -> str:
        return f"{self._keys(job_id)[0]}:events"

    def _script(self, text: str) -> Callable[..., Any]:
        return cast(Callable[..., Any], self.redis.register_script(text))

    def _run(
        self,
        script: Callable[..., Any],
        job_id: str,
        *args: str | float | bytes,
        keys: Sequence[str] = (),
        client: Redis | Pipeline | None = None,
    ) -> Any:
        common = (job_id, self.channel, repr(time.time()), self._retention, _MEMORY, self._lease)
        ours = (
            *self._keys(job_id),
            self._running,
            self._stream(job_id),
            self._counts,
            self._deadlines,
            *self._queued.values(),
        )
        return script(keys=[*ours, *keys], args=[*common, *args], client=client)

    def _index_of(self, project: str) -> str:
        return f"{self._index}:{project}"

    def _active_of(self, project: str) -> str:
        return f"{self.prefix}active:{project}"


def record_of(fields: dict[bytes, bytes]) -> JobRecord:
    """Read the hash that a record is kept as."""
    return JobRecord.from_hash({key.decode(): value.decode() for key, value in fields.items()})


def record_told(text: str) -> JobRecord:
    """Read the record that is told with the end of its job."""
    words = json.loads(text)
    return JobRecord.from_hash(dict(zip(words[::2], words[1::2], strict=True)))
