"""The service itself: what it adds to a solve, how much it takes, how soon it answers and recovers.

Every figure is measured over HTTP on a service of its own: one API process, two workers of one slot each, and
a broker that syncs every second. "no-op": the real worker, whose solve hands back an answer made before. CPU
times say what a machine that is busy otherwise would do if it were not. What is timed in milliseconds is
asked with the standard library's client over a connection that stays open: it shares the machine with the
service, and httpx takes a millisecond and a half of it for each request.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.faults.processes import API, Process, cpu_seconds, listener, memory_bytes
from tests.servers import DurableServer

Document = dict[str, Any]

SMALL: Document = {
    "problem": {
        "model": {"kind": "first_order", "states": ["x"], "controls": ["u"], "dynamics": {"x": "u"}},
        "final_time": 1,
        "initial_state": {"x": 0},
        "final_state": {"x": 1},
        "objective": {"running": "u^2"},
    },
    "method": {"name": "swcm", "L": 5, "J": 0},
    "output": {"samples": 2},
}
JOBS = 200
LONG: Document = FLEXIBLE_SPACECRAFT | {"method": {"name": "swcm", "J": 9}}

WORKER = """
import sys
from worker.main import run
sys.exit(run(concurrency=1, name=sys.argv[1]))
"""
IDLE = """
import json, sys
import worker.tasks
from worker.main import run
from solvers.spec import check_document

answer = worker.tasks.solve(check_document(json.loads(sys.argv[2])))
worker.tasks.solve = lambda *arguments, **more: answer
sys.exit(run(concurrency=1, name=sys.argv[1]))
"""


@dataclass
class Running:
    """A service: a client of its API, the API, and its workers."""

    client: httpx.Client
    api: Process
    workers: list[Process]
    broker: DurableServer

    def cpu(self) -> list[float]:
        """CPU seconds so far of the API, of all workers, of the broker, and of the clients in here."""
        return [
            self.api.cpu(),
            sum(worker.cpu() for worker in self.workers),
            cpu_seconds(self.broker.pid),
            time.process_time(),
        ]


@contextlib.contextmanager
def service(worker: str = WORKER, workers: int = 2) -> Iterator[Running]:
    """Run a service whose workers are ready."""
    with tempfile.TemporaryDirectory(prefix="ondelette-") as name, listener() as socket:
        folder = Path(name)
        broker = DurableServer(folder, "everysec")
        broker.start()
        environment = {**os.environ, "ONDELETTE_BROKER": broker.address, "OMP_NUM_THREADS": "1"}
        # One client may ask for as much as it likes here.
        environment |= {"ONDELETTE_SUBMIT_RATE": "0", "ONDELETTE_REQUEST_RATE": "0"}
        fd = socket.fileno()
        api = Process(API, [str(fd)], environment, folder / "api.log", fd)
        crew = [
            Process(worker, [f"worker{number}", json.dumps(SMALL)], environment, folder / "worker.log")
            for number in range(workers)
        ]
        address = f"http://127.0.0.1:{socket.getsockname()[1]}"
        with httpx.Client(base_url=address, timeout=70, trust_env=False) as client:
            while workers and len(_alive(client)) < workers:
                time.sleep(0.1)
            yield Running(client, api, crew, broker)
        for process in (*crew, api):
            process.end()
        broker.kill()


def _alive(client: httpx.Client) -> Document:
    answer = client.get("/readyz")
    workers: Document = answer.json()["workers"] if answer.status_code == 200 else {}
    return workers


class Caller:
    """A client for each thread that uses it, light enough to leave the machine to the service."""

    def __init__(self, client: httpx.Client) -> None:
        self._address = client.base_url.netloc.decode()
        self._own = threading.local()

    def ask(self, method: str, path: str, body: bytes | None = None, **headers: str) -> tuple[int, bytes]:
        """Ask, and return status and body of the answer."""
        if not hasattr(self._own, "connection"):
            self._own.connection = http.client.HTTPConnection(self._address, timeout=70)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        self._own.connection.request(method, path, body, named)
        answer = self._own.connection.getresponse()
        return answer.status, answer.read()

    def submit(self, document: bytes, **headers: str) -> Document:
        """Submit a job document and return the job."""
        status, answer = self.ask("POST", "/v1/jobs", document, Content_Type="application/json", **headers)
        assert status == 202, answer
        job: Document = json.loads(answer)
        return job


def main() -> None:
    """Print the table."""
    print(f"load average before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with service() as running:
        _print("submit -> done minus solve, long-poll", _overhead(running.client), "<= 8 / 30 ms")
        _print("cancel of a running solve -> final", _cancels(running.client, 20), "p99 <= 1000 ms")
    with service(IDLE) as running:
        _print("submit -> done of a no-op, long-poll", _overhead(running.client, solve=False), "<= 8 / 30 ms")
        # Long enough for every child to be replaced on the way.
        _rate("no-op jobs, 8 clients", running, _no_op, 1000, ">= 150 /s")
    with service() as running:
        _memory(running, 2000)
    with service(workers=0) as running:
        _rate("POST of a 4 kB document, 8 clients", running, _post, 500, ">= 300 /s")
    with service() as running:
        print(f"{'restart after kill -9 of the worker':<42}{_restart(running):8.1f} s  <= 45 s")
    print(f"load average after: {os.getloadavg()[0]:.1f}")


def _print(what: str, seconds: Sequence[float], asked: str) -> None:
    ordered = sorted(1e3 * each for each in seconds)
    p99 = ordered[min(len(ordered) - 1, round(0.99 * len(ordered)))]
    print(
        f"{what:<42}p50 {statistics.median(ordered):6.1f}  p99 {p99:6.1f}  min {ordered[0]:6.1f} ms  {asked}"
    )


def _overhead(client: httpx.Client, *, solve: bool = True) -> list[float]:
    """Times of jobs one after the other, each without its ``solve`` if it has one."""
    found = []
    caller, document = Caller(client), json.dumps(SMALL).encode()
    for number in range(JOBS + 10):
        began = time.perf_counter()
        job = caller.submit(document, Prefer="wait=30")
        passed = time.perf_counter() - began
        result = json.loads(caller.ask("GET", f"/v1/jobs/{job['id']}/result")[1])
        if number >= 10:  # The first ones find nothing compiled.
            found.append(passed - result["statistics"]["seconds"]["total"] * solve)
    return found


def _no_op(caller: Caller) -> None:
    job = caller.submit(json.dumps(SMALL).encode(), Prefer="wait=60")
    assert job["status"] == "succeeded", job


def _post(caller: Caller) -> None:
    document = {**FLEXIBLE_SPACECRAFT, "notes": "x" * (4096 - len(json.dumps(FLEXIBLE_SPACECRAFT)))}
    caller.submit(json.dumps(document).encode())


def _memory(running: Running, count: int) -> None:
    """Print the resident memory of the API and of a worker, with its child, while small jobs go by."""
    readings, caller = [], Caller(running.client)
    with ThreadPoolExecutor(4) as threads:
        for _ in range(4):
            list(threads.map(lambda _: _no_op(caller), range(count // 4)))
            first = running.workers[0]
            children = sum(memory_bytes(child) for child in first.children())
            readings.append([each / 2**20 for each in (running.api.memory(), first.memory(), children)])
    for name, values in zip(("API", "worker", "its child"), zip(*readings, strict=True), strict=True):
        told = ", ".join(f"{value:.1f}" for value in values)
        what = f"memory of {name}, {count} small jobs"
        print(f"{what:<42}{told} MiB after each quarter  +-5 %")


def _rate(what: str, running: Running, ask: Callable[[Caller], None], count: int, asked: str) -> None:
    """Let eight clients ask ``count`` times, and print how often a second, and the CPU time of each part."""
    caller = Caller(running.client)

    def several(number: int) -> None:
        ask(caller)

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(several, range(16)))
        before, began = running.cpu(), time.perf_counter()
        list(threads.map(several, range(count)))
        rate = count / (time.perf_counter() - began)
    api, workers, broker, clients = (
        1e3 * (after - first) / count for after, first in zip(running.cpu(), before, strict=True)
    )
    cpu = f"CPU each: API {api:.2f}, workers {workers:.2f}, broker {broker:.2f}, clients {clients:.2f} ms"
    print(f"{what:<42}{rate:8.0f} /s  {cpu}  {asked}")


def _cancels(client: httpx.Client, count: int) -> list[float]:
    found = []
    for number in range(count):
        here = _started(client)
        time.sleep(0.1 * (number % 5))
        began = time.perf_counter()
        client.post(f"{here}/cancel")
        job = client.get(here, params={"wait": 20}).json()
        if job["status"] == "cancelled":  # Others were quicker.
            found.append(time.perf_counter() - began)
    return found


def _started(client: httpx.Client) -> str:
    here: str = client.post("/v1/jobs", json=LONG).headers["location"]
    while client.get(here).json()["progress"] is None:
        time.sleep(0.02)
    return here


def _restart(running: Running) -> float:
    here = _started(running.client)
    began = time.perf_counter()
    for worker in running.workers:
        worker.kill()
    while running.client.get(here).json()["attempts"] < 2:
        time.sleep(0.05)
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
