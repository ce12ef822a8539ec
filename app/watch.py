"""Waiting for a job to end without asking for it again and again."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from typing import TypeVar

from fastapi.concurrency import run_in_threadpool
from redis.asyncio import Redis
from redis.asyncio.client import PubSub
from redis.exceptions import RedisError

from worker.address import redis_url
from worker.errors import JobGone, JobNotFound
from worker.keyspace import record_told
from worker.records import JobEvent, JobRecord
from worker.settings import QueueSettings
from worker.store import JobStore

logger = logging.getLogger(__name__)

T = TypeVar("T")

RECHECK = 2.0
"""Longest time between two looks at a job that is waited for, should a message be lost, in seconds."""

HEARTBEAT = 15.0
"""Time without an event after which a stream of events says that it is still there, in seconds."""

_RECONNECT = 0.5


class Bell(asyncio.Event):
    """Wakes one who waits; at the end of a job it brings the job's ``record``."""

    record: JobRecord | None = None


class StatusWatch:
    """One connection for the whole process, over which those are woken who wait for a job.

    All ends are heard of, but what else happens to a job only where somebody follows it. Whoever waits does
    so for a text: the id of the job or sweep whose end is awaited, or the channel of a job that is followed.
    """

    def __init__(self, store: JobStore, settings: QueueSettings) -> None:
        self._store = store
        self._settings = settings
        self._waiting: defaultdict[str, set[Bell]] = defaultdict(set)
        self._deaf = False
        self._listening = False
        self._subscribed: PubSub | None = None

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Listen as long as the context lasts."""
        task = asyncio.create_task(self._listen(), name="status-watch")
        try:
            yield
        finally:
            # More than once: a client that is just connecting may swallow a cancellation.
            while not task.done():
                task.cancel()
                await asyncio.wait([task], timeout=0.1)
            if not task.cancelled():
                task.result()

    def ending(self, named: str) -> contextlib.AbstractContextManager[Bell]:
        """Listen for the end of the job or sweep ``named`` as long as the context lasts."""
        return self._woken(named)

    async def final(self, job_id: str, seconds: float, ended: Bell | None = None) -> JobRecord:
        """Return the job when its status is final, or as it is after ``seconds``; ``ended``: see `until`."""
        return await self.until(
            job_id,
            lambda: self._store.get(job_id),
            lambda record: record.status.final,
            seconds,
            ended,
            lambda bell: bell.record,
        )

    async def until(
        self,
        named: str,
        look: Callable[[], T],
        done: Callable[[T], bool],
        seconds: float,
        ended: Bell | None = None,
        told: Callable[[Bell], T | None] = lambda bell: None,
    ) -> T:
        """Return what ``look`` sees when it is ``done``, or after ``seconds``.

        It looks again when the job or sweep ``named`` ends, unless the bell has ``told`` it. ``ended`` is the
        bell of `ending` where that was listened for before the job was made: then it need not look before.
        """
        clock = asyncio.get_running_loop().time
        deadline = clock() + seconds
        unseen = ended is None or not self._listening
        with self.ending(named) if ended is None else contextlib.nullcontext(ended) as bell:
            while True:
                if unseen:
                    bell.clear()
                    seen = await run_in_threadpool(look)
                    if done(seen) or clock() >= deadline:
                        return seen
                unseen = True
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(min(deadline - clock(), RECHECK)):
                        await bell.wait()
                if (seen_at_its_end := told(bell)) is not None:
                    return seen_at_its_end

    async def events(self, job_id: str, after: str) -> AsyncIterator[JobEvent | None]:
        """Iterate over the events of a job from behind ``after`` until it ends; None says that all is quiet.

        While the broker is away all is quiet too; it goes on with what was missed.
        """
        clock = asyncio.get_running_loop().time
        spoke = clock()
        channel = self._store.channel_of(job_id)
        with self._woken(channel) as woken:
            # Where there is no connection now, the next one begins with all that is followed.
            if self._subscribed is not None:
                with contextlib.suppress(RedisError):
                    await self._subscribed.subscribe(channel)
            while True:
                woken.clear()
                try:
                    ended, news = await run_in_threadpool(self._look, job_id, after)
                except RedisError:
                    ended, news = False, []
                for event in news:
                    yield event
                    after, spoke = event.number, clock()
                    ended = ended or event.last
                if ended:
                    return
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(RECHECK):
                        await woken.wait()
                if clock() - spoke > HEARTBEAT:
                    yield None
                    spoke = clock()

    def _look(self, job_id: str, after: str) -> tuple[bool, list[JobEvent]]:
        try:
            # In this order: of a job that had ended before, all events are there to be read.
            ended = self._store.get(job_id).status.final
            return ended, self._store.events(job_id, after)
        except (JobNotFound, JobGone):
            return True, []

    @contextlib.contextmanager
    def _woken(self, text: str) -> Iterator[Bell]:
        bell = Bell()
        self._waiting[text].add(bell)
        try:
            yield bell
        finally:
            self._waiting[text].discard(bell)
            if not self._waiting[text]:
                del self._waiting[text]

    async def _listen(self) -> None:
        while True:
            try:
                await self._follow()
            except (RedisError, OSError) as error:
                self._listening = False
                if not self._deaf:
                    logger.warning(
                        "no messages from the broker (%s); looking at jobs every %g s", error, RECHECK
                    )
                self._deaf = True
                await asyncio.sleep(_RECONNECT)

    async def _follow(self) -> None:
        client = Redis.from_url(redis_url(self._settings.broker), socket_connect_timeout=2.0)
        ends = self._store.channel
        async with client, client.pubsub() as subscribed:
            await subscribed.subscribe(ends, *(text for text in self._waiting if text.startswith(ends)))
            self._subscribed = subscribed
            try:
                while True:
                    message = await subscribed.get_message(timeout=30.0)
                    if message is None:
                        # Silence for long may be a dead connection: an answer, or an error, tells.
                        await subscribed.ping()
                        continue
                    if message["type"] not in ("message", "subscribe"):
                        continue
                    channel = message["channel"].decode()
                    if message["type"] == "subscribe":
                        self._hear(channel)
                    elif channel == ends:
                        self._end(*message["data"].decode().split(" ", 1))
                    elif channel in self._waiting:
                        self._wake([channel])
                    else:
                        await subscribed.unsubscribe(channel)
            finally:
                self._subscribed = None

    def _hear(self, channel: str) -> None:
        """Let those look who wait for what comes by a channel: it may have come before anybody listened."""
        if channel != self._store.channel:
            self._wake([channel])
            return
        if self._deaf:
            logger.warning("messages from the broker again")
        self._deaf = False
        self._listening = True
        self._wake(tuple(self._waiting))

    def _end(self, named: str, record: str | None = None) -> None:
        if record is not None and named in self._waiting:
            told = record_told(record)
            for bell in self._waiting[named]:
                bell.record = told
        self._wake([named, self._store.channel_of(named)])

    def _wake(self, texts: Iterable[str]) -> None:
        for text in texts:
            for bell in self._waiting.get(text, ()):
                bell.set()
