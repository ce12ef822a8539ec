"""A worker process: fetches jobs, solves each in a child process, hands back what it cannot finish."""

from __future__ import annotations

import gc
import logging
import os
import socket

from worker import logs, traces
from worker.blobs import Blobs
from worker.settings import WorkerSettings


def run(
    broker: str | None = None,
    concurrency: int | None = None,
    *,
    name: str | None = None,
    log_level: str | None = None,
) -> int:
    """Work until SIGTERM or SIGINT; return the exit status.

    ``broker`` is the server's address (default: ``ONDELETTE_BROKER``), ``concurrency`` the number of jobs
    solved at a time (default: the number of cores), ``name`` tells this worker from others of the same queue.
    SIGTERM lets running jobs go on for ``ONDELETTE_SHUTDOWN_SECONDS``, then returns them to the queue.
    """
    # A child solves one job on one core; the linear algebra must know before it is loaded.
    os.environ["OMP_NUM_THREADS"] = "1"
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    traces.require()
    settings = WorkerSettings() if broker is None else WorkerSettings(broker=broker)
    slots = concurrency or os.cpu_count() or 1
    if settings.results is not None:
        # No job is to be solved by a worker that cannot store its answer (a volume that was not mounted).
        Blobs(settings.results).probe()

    # Imported here, once, in the parent: the children are forked with everything loaded.
    from celery.signals import setup_logging, worker_process_init, worker_process_shutdown

    from solvers.warmup import warm_up
    from worker.celery_app import make_celery
    from worker.consumer import PromptConsumer
    from worker.heartbeat import heartbeat
    from worker.leases import leases
    from worker.memory import limit_memory, require_memory
    from worker.neighbours import Neighbours
    from worker.pool import WatchedPool
    from worker.queue import JobQueue
    from worker.shutdown import PatientWorker
    from worker.store import JobStore, connect
    from worker.sweeps import SweepStore
    from worker.tasks import Limits, SolveTask

    warm_up()
    require_memory(settings.memory_mib)
    celery = make_celery(settings)
    celery.conf.update(
        worker_max_tasks_per_child=settings.tasks_per_child,
        # A child that died may have left its answer in the pipe; the store would know it, so not for long.
        worker_lost_wait=1.0,
    )
    store = JobStore(connect(settings, retries=10), settings)
    limits = Limits(round(settings.result_mib * 2**20), settings.grace_seconds, settings.outage_seconds)
    celery.register_task(SolveTask(store, limits, Neighbours(store, SweepStore(store, settings))))
    queue = JobQueue(connect(settings), settings)
    steps = celery.steps["consumer"]
    steps.add(heartbeat(queue, slots, settings.heartbeat_seconds))
    steps.add(leases(JobStore(connect(settings), settings), settings.renewal_seconds))

    def start_traces(**_: object) -> None:
        # In each child: a thread that sends does not survive a fork.
        traces.start("ondelette-worker")

    def write_logs(loglevel: int | str, **_: object) -> None:
        logs.set_up(settings.log_format, logging.getLevelName(loglevel))

    worker_process_init.connect(lambda **_: limit_memory(settings.memory_mib), weak=False)
    worker_process_init.connect(start_traces, weak=False)
    worker_process_shutdown.connect(lambda **_: traces.flush(), weak=False)
    # That somebody listens keeps Celery from logging in its own way.
    setup_logging.connect(write_logs, weak=False)
    worker = PatientWorker(
        app=celery,
        store=JobStore(connect(settings), settings),
        patience=settings.shutdown_seconds,
        hostname=f"{name or os.getpid()}@{socket.gethostname()}",
        pool=WatchedPool,
        consumer_cls=PromptConsumer,
        concurrency=slots,
        loglevel=log_level or settings.log_level,
        quiet=True,
        without_gossip=True,
        without_mingle=True,
        without_heartbeat=True,
    )
    # What is loaded stays. No collection looks at it again, be it here or in a child, which would copy it.
    gc.freeze()
    worker.start()
    return int(worker.exitcode or 0)
