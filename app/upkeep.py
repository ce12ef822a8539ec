"""What the API does besides answering: looking after jobs that nobody works on, or waits for."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Callable

from fastapi.concurrency import run_in_threadpool

from app.webhooks import LOOK, Webhooks
from worker.errors import STORE_AWAY, QueueUnavailable
from worker.reconciler import Reconciler

logger = logging.getLogger(__name__)

DEADLINES = 0.5
"""Time between two looks for jobs whose deadline has passed, in seconds."""


@contextlib.asynccontextmanager
async def upkeep(reconciler: Reconciler, webhooks: Webhooks, period: float) -> AsyncIterator[None]:
    """Let ``reconciler`` take its turn every ``period`` seconds, mind deadlines, send messages, meanwhile."""
    # A little less than the period, in which one of all processes takes a turn.
    reconciling = _regularly(lambda: reconciler.take_turn(period), 0.9 * period)
    tasks = [
        asyncio.create_task(reconciling, name="reconciler"),
        asyncio.create_task(_regularly(reconciler.give_up_overdue, DEADLINES), name="deadlines"),
        asyncio.create_task(_regularly(webhooks.send_due, LOOK), name="webhooks"),
    ]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task


async def _regularly(look: Callable[[], None], period: float) -> None:
    away = False
    while True:
        try:
            await run_in_threadpool(look)
        except (*STORE_AWAY, QueueUnavailable) as error:
            if not away:
                logger.warning("the store does not answer (%s); jobs are looked after when it does", error)
            away = True
        except Exception:
            logger.exception("looking after jobs has failed; it goes on")
        else:
            away = False
        await asyncio.sleep(period)
