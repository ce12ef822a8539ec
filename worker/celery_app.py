"""Celery's settings, each with its reason: how messages are fetched, held, acknowledged and given back."""

from __future__ import annotations

from celery import Celery
from kombu import Exchange, Queue

from worker.address import celery_url
from worker.priorities import queue_of
from worker.records import Priority
from worker.settings import QueueSettings

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
        # Nor is there anything to be fetched more slowly for a while after the broker was away; Celery's
        # bookkeeping of that asks the pool, which at a shutdown may be gone.
        worker_enable_prefetch_count_reduction=False,
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
