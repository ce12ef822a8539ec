"""The whole service as it runs in production: server, worker and API, each a process."""

from __future__ import annotations

import copy
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.bad_documents import FLEXIBLE_SPACECRAFT
from worker.queue import JobQueue
from worker.settings import QueueSettings
from worker.store import JobStore, connect

Document = dict[str, Any]
WORKER = (
    "import sys; from worker.main import run; sys.exit(run(concurrency=int(sys.argv[1]), name=sys.argv[2]))"
)
API = (
    "import socket, sys, uvicorn; from app.main import create_app;"
    "config = uvicorn.Config(create_app(), access_log=False, timeout_graceful_shutdown=2);"
    "uvicorn.Server(config).run(sockets=[socket.socket(fileno=int(sys.argv[1]))])"
)


# Leases that are over soon, so that tests need not wait for half a minute.
SHORT = {
    "ONDELETTE_VISIBILITY_SECONDS": "3",
    "ONDELETTE_RENEWAL_SECONDS": "1",
    "ONDELETTE_SWEEP_SECONDS": "0.5",
}


@dataclass(frozen=True)
class Running:
    """A running process and the file that it writes to."""

    process: subprocess.Popen[bytes]
    log: Path


@dataclass(frozen=True)
class Deployment:
    """Starts the processes of a service of its own on a given server."""

    settings: QueueSettings
    directory: Path

    @property
    def environment(self) -> dict[str, str]:
        """The environment from which every process reads where the others are."""
        own = {"ONDELETTE_BROKER": self.settings.broker, "ONDELETTE_PREFIX": self.settings.prefix}
        return {**os.environ, **own, "OMP_NUM_THREADS": "1"}

    @contextmanager
    def worker(self, slots: int = 2, name: str = "one", **environment: str) -> Iterator[Running]:
        """A worker that is alive; ended like a container, by SIGTERM."""
        with self._process([WORKER, str(slots), name], f"worker-{name}", environment) as running:
            self._wait_for(name, running)
            yield running

    @contextmanager
    def api(self, **environment: str) -> Iterator[httpx.Client]:
        """A client of an API that answers."""
        with socket.create_server(("127.0.0.1", 0)) as listener:
            port = listener.getsockname()[1]
            fd = listener.fileno()
            with (
                self._process([API, str(fd)], "api", environment, fd) as running,
                httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=75, trust_env=False) as client,
            ):
                wait_until(lambda: client.get("/livez").status_code == 200, running)
                yield client

    @contextmanager
    def both(
        self, slots: int = 2, name: str = "one", **environment: str
    ) -> Iterator[tuple[Running, httpx.Client]]:
        """A worker that is alive and a client of an API that answers, started side by side."""
        with (
            self._process([WORKER, str(slots), name], f"worker-{name}", environment) as running,
            self.api(**environment) as client,
        ):
            self._wait_for(name, running)
            yield running, client

    def _wait_for(self, name: str, running: Running) -> None:
        with connect(self.settings) as redis:
            queue = JobQueue(redis, self.settings)
            wait_until(lambda: any(alive.startswith(f"{name}@") for alive in queue.workers()), running, 60.0)

    @contextmanager
    def _process(
        self, command: list[str], name: str, environment: dict[str, str], *descriptors: int
    ) -> Iterator[Running]:
        log = self.directory / f"{name}.log"
        with log.open("ab") as output:
            process = subprocess.Popen(
                [sys.executable, "-c", *command],
                env=self.environment | environment,
                stdout=output,
                stderr=output,
                pass_fds=descriptors,
            )
        try:
            yield Running(process, log)
        finally:
            process.send_signal(signal.SIGTERM)
            process.send_signal(signal.SIGCONT)
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                raise


def wait_until(condition: Callable[[], bool], running: Running | None = None, seconds: float = 20.0) -> None:
    """Wait for a condition; fails after ``seconds``, or with the log of a process that ended meanwhile."""
    give_up = time.monotonic() + seconds
    while not condition():
        if running is not None and running.process.poll() is not None:
            pytest.fail(f"the process ended with {running.process.returncode}:\n{running.log.read_text()}")
        if time.monotonic() > give_up:
            pytest.fail("waited in vain" + (f":\n{running.log.read_text()}" if running else ""))
        time.sleep(0.02)


@pytest.fixture(scope="session")
def deployment(broker: str, tmp_path_factory: pytest.TempPathFactory) -> Deployment:
    """The service that most tests share."""
    return Deployment(
        QueueSettings(broker=broker, prefix="acceptance:"), tmp_path_factory.mktemp("acceptance")
    )


@pytest.fixture(scope="session")
def service(deployment: Deployment) -> Iterator[httpx.Client]:
    """A client of the shared service, which is ready."""
    with deployment.both(ONDELETTE_BODY_BYTES=str(2 * 2**20)) as (_, client):
        assert client.get("/readyz").status_code == 200
        yield client


@pytest.fixture(scope="session")
def shared_store(deployment: Deployment) -> Iterator[JobStore]:
    """The shared service's store, seen from outside."""
    with connect(deployment.settings) as redis:
        yield JobStore(redis, deployment.settings)


@pytest.fixture(scope="session")
def shared_queue(deployment: Deployment, shared_store: JobStore) -> JobQueue:
    """The shared service's queue, seen from outside."""
    return JobQueue(shared_store.redis, deployment.settings)


@pytest.fixture
def spacecraft() -> Document:
    """The flexible spacecraft's slew, to be changed at will."""
    return copy.deepcopy(FLEXIBLE_SPACECRAFT)


@pytest.fixture
def long_job() -> Document:
    """A document that takes some seconds, in short iterations."""
    document = copy.deepcopy(FLEXIBLE_SPACECRAFT)
    document["method"] = {"name": "swcm", "J": 11}
    document["options"]["tolerance"] = 1e-12
    return document
