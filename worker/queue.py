"""The queue: Celery's settings, how a job is published, how long the line is and who serves it."""

from __future__ import annotations

import json
import math
import time
from typing import cast

from celery import Celery
from celery.exceptions import CeleryError
from kombu import Exchange, Queue
from kombu.exceptions import KombuError
from redis import Redis
from redis.exceptions import RedisError

from worker.address import celery_url
from worker.errors import QueueUnavailable
from worker.logs import request_id
from worker.priorities import queue_of
from worker.records import JobRecord, Priority
from worker.settings import QueueSettings
from worker.traces import carried

_PUBLISHED = "published"
REQUEST_HEADER = "request_id"
SOLVE_TASK = "ondelette.solve"
MAX_JOB_SECONDS = 3600
"""Largest options.max_seconds of a document, in seconds."""


def make_celery(settings: QueueSettings) -> Celery:
    """Return a Celery application for the broker of ``settings``.

    A message is acknowledged when its job has ended, and redelivered if the worker's child dies before; the
    job record, not a result backend, tells how it went. No soft time limit: CasADi swallows the exception.
    """
    celery = Celery("ondelette", broker=celery_url(settings.broker), set_as_current=False)
    celery.conf.update(
        task_default_queue=queue_of(Priority.NORMAL),
        task_queues=[
            Queue(name, Exchange("", type="direct"), routing_key=name) for name in map(queue_of, Priority)
        ],
        task_create_missing_queues=False,
        task_acks_late=True,
        task_reject_on_worker_lost=True,
        task_ignore_result=True,
        task_store_errors_even_if_ignored=False,
        task_serializer="json",
        result_serializer="json",
        event_serializer="json",
        accept_content=["json"],
        task_time_limit=MAX_JOB_SECONDS + settings.grace_seconds + settings.outage_seconds,
        worker_prefetch_multiplier=1,
        # A message that waits inside a worker could not be overtaken by a more urgent one.
        worker_disable_prefetch=True,
        worker_cancel_long_running_tasks_on_connection_loss=False,
        worker_send_task_events=False,
        worker_enable_remote_control=False,
        broker_connection_retry_on_startup=True,
        broker_connection_max_retries=None,
        # A server that is full refuses commands; a worker that takes that for the end loses what it solves.
        broker_channel_error_retry=True,
        broker_transport_options={
            # Short only because every worker renews the lease of what it holds (worker.leases); else a job
            # that takes longer would be delivered again and again.
            "visibility_timeout": settings.visibility_seconds,
            "unacked_restore_interval": settings.sweep_seconds,
            "unacked_restore_throttle": 1,
            # A worker that is killed during a sweep keeps the others from theirs for so long, in seconds.
            "unacked_mutex_expire": 10,
            "health_check_interval": 25,
            "socket_keepalive": True,
            "socket_timeout": 30,
            "socket_connect_timeout": 5,
            "retry_on_timeout": True,
            "global_keyprefix": settings.prefix,
            "queue_order_strategy": "worker.priorities:Turns",
            # No further priorities within a queue, each of which would be a key to ask for.
            "priority_steps": [0],
        },
    )
    return celery


def _about() -> dict[str, str]:
    """What a message carries of the request that it comes from: its id, and the context of its trace."""
    request = request_id.get()
    return carried() if request is None else {REQUEST_HEADER: request, **carried()}


class JobQueue:
    """Where jobs wait. Safe to share between threads."""

    def __init__(self, celery: Celery, redis: Redis, settings: QueueSettings) -> None:
        self._celery = celery
        self._redis = redis
        self._prefix = settings.prefix
        # A child ends itself at max_seconds + grace; this is for one that cannot even do that.
        self._beyond = settings.grace_seconds + settings.outage_seconds

    def enqueue(self, record: JobRecord) -> None:
        """Publish a recorded job. Raises QueueUnavailable if the broker did not take it."""
        try:
            self._celery.send_task(
                SOLVE_TASK,
                args=[record.id],
                task_id=record.id,
                queue=queue_of(record.priority),
                headers={_PUBLISHED: time.time(), **_about()},
                time_limit=math.ceil(record.max_seconds + self._beyond),
                retry=True,
                retry_policy={"max_retries": 1, "interval_start": 0.1, "interval_step": 0.2},
            )
        except (KombuError, CeleryError, RedisError, OSError) as error:
            raise QueueUnavailable("the broker did not take the job") from error

    def close(self) -> None:
        """Close the connections by which jobs are published."""
        self._celery.close()

    def head(self, priority: Priority) -> float | None:
        """Return when the message of a priority that is fetched next was published, None if there is none."""
        message = cast(bytes | None, self._redis.lindex(self._key(priority), -1))
        return None if message is None else float(json.loads(message)["headers"][_PUBLISHED])

    def in_flight(self) -> set[str]:
        """Return the ids of the jobs whose messages workers hold, or held before they were lost."""
        held = cast(list[bytes], self._redis.hvals(f"{self._prefix}unacked"))
        return {str(json.loads(text)[0]["headers"]["id"]) for text in held}

    def depth(self) -> int:
        """Return how many jobs wait that no worker has fetched."""
        with self._redis.pipeline(transaction=True) as pipe:
            for priority in Priority:
                pipe.llen(self._key(priority))
            return sum(pipe.execute())

    def _key(self, priority: Priority) -> str:
        return f"{self._prefix}{queue_of(priority)}"

    # A worker is alive as long as it says so: a key for each, which the server lets expire.

    def beat(self, worker: str, slots: int, seconds: float) -> None:
        """Note that ``worker``, which solves ``slots`` jobs at a time, is alive for the next ``seconds``."""
        with self._redis.pipeline(transaction=True) as pipe:
            pipe.sadd(f"{self._prefix}workers", worker)
            pipe.set(f"{self._prefix}worker:{worker}", slots, px=round(1000 * seconds))
            pipe.execute()

    def leave(self, worker: str) -> None:
        """Note that ``worker`` takes no more jobs."""
        with self._redis.pipeline(transaction=True) as pipe:
            pipe.srem(f"{self._prefix}workers", worker)
            pipe.delete(f"{self._prefix}worker:{worker}")
            pipe.execute()

    def workers(self) -> dict[str, int]:
        """Return the workers that are alive, each with the number of jobs that it solves at a time."""
        names = sorted(cast(set[bytes], self._redis.smembers(f"{self._prefix}workers")))
        if not names:
            return {}
        slots = cast(
            list[bytes | None], self._redis.mget([f"{self._prefix}worker:{name.decode()}" for name in names])
        )
        silent = [name for name, number in zip(names, slots, strict=True) if number is None]
        if silent:
            self._redis.srem(f"{self._prefix}workers", *silent)
        return {
            name.decode(): int(number)
            for name, number in zip(names, slots, strict=True)
            if number is not None
        }
