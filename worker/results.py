"""Where compressed results are: in the server's memory, or, by configuration, outside of it.

Under the result's key in Redis stand its bytes, or a reference to a blob. The blob is written first, under a
name that holds the job's id and its owner's word, and the script that ends the job, which is a
compare-and-set by that word, stores the reference: a result becomes one together with the end of its job,
wherever its bytes are. Two solves of one job write two blobs, and the one that is not referred to is no
result. Before a blob is written it is put into a register, so that none is ever forgotten: the
reconciler looks at each again and again and deletes those that no job refers to, nor can refer to any more.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import time
import zlib
from collections.abc import Callable
from typing import cast

from redis import Redis

from worker.blobs import Blobs
from worker.errors import ResultLost, ResultsUnavailable
from worker.settings import QueueSettings

logger = logging.getLogger(__name__)

# No zlib stream (RFC 1950) begins like this.
_MARK = b"blob:"
LONGEST_REFERENCE = 256
"""Most bytes of a reference to a result that is outside of the server."""
_FIRST_LOOK = 3_600.0


class Results:
    """Packs and unpacks what stands under the result's key of a job.

    Methods raise ResultsUnavailable where the place outside does not answer, and RedisError.
    """

    def __init__(self, redis: Redis, settings: QueueSettings) -> None:
        self._redis = redis
        self._register = f"{settings.prefix}results"
        self._retention = settings.retention_seconds
        self._blobs = None if settings.results is None else Blobs(settings.results)

    def put(self, job_id: str, word: str, packed: bytes) -> bytes:
        """Keep a compressed result; return what is to stand under the job's key.

        ``word`` is part of the name of whoever may refer to it. Asked again, it is written again.
        """
        if self._blobs is None:
            return packed
        own = word.rpartition("/")[2]
        name = f"{job_id}.{own}.{hashlib.sha256(packed).hexdigest()[:16]}"
        self._look_again(name, _FIRST_LOOK)
        self._blobs.write(name, packed)
        return _MARK + name.encode()

    def read(self, stored: bytes) -> bytes:
        """Return the compressed result that is meant; raises ResultLost if it is not there any more."""
        name = _name(stored)
        if name is None:
            return stored
        if self._blobs is None:
            raise ResultsUnavailable("a result is outside of the broker; ONDELETTE_RESULTS must say where")
        return self._blobs.read(name)

    def unpack(self, stored: bytes) -> bytes:
        """Return the JSON text that is meant; raises ResultLost if it is not there any more, or damaged."""
        return self.both(stored)[1]

    def both(self, stored: bytes) -> tuple[bytes, bytes]:
        """Return what is meant, compressed and as JSON text; raises as `unpack` does."""
        packed = self.read(stored)
        try:
            return packed, zlib.decompress(packed)
        except zlib.error as error:
            raise ResultLost(f"the compressed result is damaged: {error}") from error

    def drop(self, stored: bytes) -> None:
        """Delete what nothing refers to any more; what cannot be reached is deleted at a later look."""
        name = _name(stored)
        if name is not None and self._blobs is not None:
            with contextlib.suppress(ResultsUnavailable):
                self._delete(name, self._blobs)

    def tidy(self, limit: int, look: Callable[[str], tuple[bool, bytes | None, float]]) -> int:
        """Look at up to ``limit`` blobs whose time has come; return how many were deleted.

        ``look`` tells of a job whether it may still get a result, what stands under its result's key, and
        for how many seconds more (negative: without end).
        """
        if self._blobs is None:
            return 0
        due = cast(
            list[bytes],
            self._redis.zrangebyscore(self._register, "-inf", repr(time.time()), start=0, num=limit),
        )
        deleted = 0
        for name in (member.decode() for member in due):
            active, stored, left = look(name.partition(".")[0])
            if active:
                self._look_again(name, _FIRST_LOOK)
            elif stored == _MARK + name.encode():
                self._look_again(name, left if left >= 0 else self._retention)
            else:
                self._delete(name, self._blobs)
                deleted += 1
        return deleted

    def _look_again(self, name: str, seconds: float) -> None:
        self._redis.zadd(self._register, {name: time.time() + seconds})

    def _delete(self, name: str, blobs: Blobs) -> None:
        blobs.delete(name)
        self._redis.zrem(self._register, name)
        logger.info("job %s: a result that nothing refers to is deleted", name.partition(".")[0])


def _name(stored: bytes) -> str | None:
    return stored.removeprefix(_MARK).decode() if stored.startswith(_MARK) else None
