"""Workers on hosts of their own, against one broker with a password: each in a network of its own.

Needs root and iproute2 (network namespaces); elsewhere the test says that it was left out.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from urllib.parse import quote

import httpx
import pytest
from redis import Redis
from redis.exceptions import AuthenticationError

from app.client import Client
from app.embedded.binary import find_server
from tests.acceptance.conftest import SHORT, WORKER, Document, wait_until
from tests.acceptance.test_compose import free_port, process

PASSWORD = "a password of the broker"
MARK = f"ond{os.getpid() % 10_000}"
BROKER_ADDRESS = "10.213.77.1"

pytestmark = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("ip") is None or shutil.which("unshare") is None,
    reason="needs root and iproute2",
)


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


@contextmanager
def network() -> Iterator[str]:
    """A bridge on this machine, to which hosts are connected; it has the broker's address."""
    bridge = f"{MARK}br"
    ip("link", "add", bridge, "type", "bridge")
    try:
        ip("addr", "add", f"{BROKER_ADDRESS}/24", "dev", bridge)
        ip("link", "set", bridge, "up")
        yield bridge
    finally:
        ip("link", "del", bridge)


@contextmanager
def host(bridge: str, number: int) -> Iterator[str]:
    """A host with an address of its own; nothing but the bridge connects it. Yields its name."""
    name, outside, inside = f"{MARK}h{number}", f"{MARK}o{number}", f"{MARK}i{number}"
    ip("netns", "add", name)
    try:
        ip("link", "add", outside, "type", "veth", "peer", "name", inside, "netns", name)
        ip("link", "set", outside, "master", bridge, "up")
        ip("-n", name, "addr", "add", f"10.213.77.{10 + number}/24", "dev", inside)
        ip("-n", name, "link", "set", inside, "up")
        ip("-n", name, "link", "set", "lo", "up")
        yield name
    finally:
        ip("netns", "del", name)


def cable(name: str, *, plugged: bool) -> None:
    """Pull the cable of a host, or plug it in again."""
    ip("link", "set", name.replace("h", "o", 1), "up" if plugged else "down")


@dataclass(frozen=True)
class Hosts:
    """The API's address, the port of the broker, and the log of the worker of each host by its name."""

    url: str
    port: int
    logs: dict[str, Path]

    def solved(self, jobs: list[str]) -> dict[str, list[str]]:
        """Which of some jobs, all of them solved, the worker of each host says that it has solved.

        It says so when the end of the job is already known to everybody.
        """

        def told() -> dict[str, list[str]]:
            texts = {name: log.read_text() for name, log in self.logs.items()}
            return {
                name: [job for job in jobs if f"job {job}: succeeded" in text] for name, text in texts.items()
            }

        wait_until(lambda: set(jobs) <= set(chain(*told().values())))
        return told()


@pytest.fixture
def hosts(tmp_path: Path) -> Iterator[Hosts]:
    port, api_port = free_port(), free_port()
    broker = [str(find_server().path), "--port", str(port), "--bind", BROKER_ADDRESS]
    broker += ["--requirepass", PASSWORD, "--appendonly", "yes", "--maxmemory-policy", "noeviction"]
    address = f"redis://:{quote(PASSWORD)}@{BROKER_ADDRESS}:{port}/0"
    environment = {**os.environ, **SHORT, "ONDELETTE_BROKER": address, "OMP_NUM_THREADS": "1"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    logs: dict[str, Path] = {}
    with ExitStack() as stack:
        bridge = stack.enter_context(network())
        stack.enter_context(process(broker, cwd=tmp_path, **quiet))
        for number in (1, 2):
            name = stack.enter_context(host(bridge, number))
            logs[name] = tmp_path / name
            named = f'hostname {name}; exec "$@"'
            command = ["ip", "netns", "exec", name, "unshare", "--uts", "sh", "-c", named, "sh"]
            command += [sys.executable, "-c", WORKER, "1", "worker"]
            output = stack.enter_context(logs[name].open("wb"))
            stack.enter_context(process(command, env=environment, stdout=output, stderr=output))
        api = [sys.executable, "-m", "app.cli", "api", "--port", str(api_port)]
        stack.enter_context(process(api, env=environment, **quiet))
        yield Hosts(f"http://127.0.0.1:{api_port}", port, logs)


def workers_of(url: str) -> set[str]:
    """The names of the hosts whose workers are alive."""
    try:
        answer = httpx.get(f"{url}/readyz", trust_env=False).json()
    except httpx.TransportError:
        return set()
    return {worker.partition("@")[2] for worker in answer.get("workers", ())}


def test_two_hosts_share_the_work_and_stand_in_for_each_other(hosts: Hosts, spacecraft: Document) -> None:
    with Redis(host=BROKER_ADDRESS, port=hosts.port) as stranger, pytest.raises(AuthenticationError):
        stranger.ping()
    first, second = hosts.logs
    wait_until(lambda: workers_of(hosts.url) == {first, second}, seconds=40)
    with Client(hosts.url) as client:
        spacecraft["method"]["J"] = 6
        jobs = [client.submit(spacecraft)["id"] for _ in range(6)]
        assert {client.wait(job, timeout=60)["status"] for job in jobs} == {"succeeded"}
        solved = hosts.solved(jobs)
        assert all(solved.values())
        assert sorted(solved[first] + solved[second]) == sorted(jobs)

        # A host that is cut off loses its job to the other one.
        spacecraft["method"]["J"] = 9
        jobs = [client.submit(spacecraft)["id"] for _ in range(3)]
        wait_until(lambda: all(client.job(job)["status"] != "queued" for job in jobs[:2]))
        cable(first, plugged=False)
        assert {client.wait(job, timeout=90)["status"] for job in jobs} == {"succeeded"}
        cable(first, plugged=True)
        assert hosts.solved(jobs)[second] == jobs
