"""The commands of docker-compose.yml, run as processes around one server with a password."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from app.client import Client, RequestRefused, ServerUnreachable
from app.embedded.binary import find_server
from tests.bad_documents import FLEXIBLE_SPACECRAFT

SERVICES: dict[str, Any] = yaml.safe_load((Path(__file__).parents[2] / "docker-compose.yml").read_text())[
    "services"
]
PASSWORD = "0f1e2d3c4b5a"
VARIABLE = re.compile(r"\$\{(\w+):([-?])([^}]*)\}")
KEY = "0123456789abcdef" * 4


def substituted(variable: re.Match[str]) -> str:
    """What Compose puts in place of a variable: its value, or the default after :-."""
    name, kind, text = variable.groups()
    known = {"ONDELETTE_REDIS_PASSWORD": PASSWORD}
    assert name in known or kind == "-", f"nobody gives {name}"
    return known.get(name, text)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


@contextmanager
def process(command: list[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is stopped as a container is, within the time that its service gives it."""
    with subprocess.Popen(command, **options) as started:
        try:
            yield started
        finally:
            started.send_signal(signal.SIGTERM)
            started.wait(20)


@pytest.fixture
def compose(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The address of the API, and the processes of API and workers."""
    port, broker_port = free_port(), free_port()
    words = [VARIABLE.sub(substituted, word) for word in SERVICES["redis"]["command"]]
    broker = [str(find_server().path), *words[1:], "--port", str(broker_port), "--bind", "127.0.0.1"]
    secret = tmp_path / "ondelette_key"
    secret.write_text(f"{KEY}\n")
    environment = {**os.environ, "ONDELETTE_BOOTSTRAP_KEY_FILE": str(secret)}
    environment |= {"ONDELETTE_BROKER": f"redis://:{PASSWORD}@127.0.0.1:{broker_port}/0"}
    api = SERVICES["api"]["command"][1:]
    api[api.index("--port") + 1] = str(port)
    ondelette = [sys.executable, "-m", "app.cli"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with (
        process(broker, cwd=tmp_path, **quiet),
        process([*ondelette, *api], env=environment, **quiet) as web,
        process([*ondelette, *SERVICES["worker"]["command"][1:]], env=environment, **quiet) as first,
        process([*ondelette, *SERVICES["worker"]["command"][1:]], env=environment, **quiet) as second,
    ):
        yield f"http://127.0.0.1:{port}", [web, first, second]


def test_the_containers_commands_make_a_service(compose: tuple[str, list[subprocess.Popen[bytes]]]) -> None:
    url, processes = compose
    with Client(url, key=KEY) as client:
        deadline = time.monotonic() + 30
        while True:
            try:
                jobs = [client.submit(FLEXIBLE_SPACECRAFT)["id"] for _ in range(4)]
            except (ServerUnreachable, RequestRefused):
                assert time.monotonic() < deadline
                time.sleep(0.1)
            else:
                break
        results = [client.result(client.wait(job, timeout=30)["id"]) for job in jobs]
    assert all(result["success"] for result in results)
    with Client(url) as stranger, pytest.raises(RequestRefused, match="Unauthorized"):
        next(stranger.jobs())
    for child in processes:
        child.send_signal(signal.SIGTERM)
    assert [child.wait(10) for child in processes] == [0, 0, 0]
