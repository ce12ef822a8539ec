"""What the API does besides answering: looking after jobs that nobody works on."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator

from fastapi.concurrency import run_in_threadpool
from redis.exceptions import RedisError

from worker.errors import QueueUnavailable
from worker.reconciler import Reconciler

logger = logging.getLogger(__name__)


@contextlib.asynccontextmanager
async def upkeep(reconciler: Reconciler, period: float) -> AsyncIterator[None]:
    """Let ``reconciler`` take its turn every ``period`` seconds as long as the context lasts."""
    task = asyncio.create_task(_reconcile(reconciler, period), name="reconciler")
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def _reconcile(reconciler: Reconciler, period: float) -> None:
    away = False
    while True:
        try:
            await run_in_threadpool(reconciler.take_turn, period)
        except (RedisError, QueueUnavailable) as error:
            if not away:
                logger.warning("the broker does not answer (%s); jobs are looked after when it does", error)
            away = True
        else:
            away = False
        # A little less than the period, in which one of all processes takes a turn.
        await asyncio.sleep(0.9 * period)
