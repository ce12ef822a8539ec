"""What happens to jobs when the broker is lost, late or empty."""

import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, cast

import httpx
import pytest
from redis import Redis

from app.client import Client
from tests.acceptance.conftest import SHORT, Deployment, Running, wait_until
from tests.faults.processes import WORKER, Process
from tests.problems import problem
from tests.servers import DurableServer
from worker.priorities import queue_of
from worker.queue import JobQueue
from worker.records import Priority
from worker.settings import QueueSettings
from worker.store import connect

Document = dict[str, Any]
PREFIX = "faults:"
QUEUE = queue_of(Priority.NORMAL)


@pytest.fixture(scope="module")
def server() -> Iterator[DurableServer]:
    """A server of this file's own."""
    # Not pytest's own directory: a socket's path may have about 100 characters at most.
    with tempfile.TemporaryDirectory(prefix="ondelette-") as directory:
        server = DurableServer(Path(directory))
        server.start()
        yield server
        server.kill()


@pytest.fixture(scope="module")
def service(
    server: DurableServer, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Running, httpx.Client]]:
    """A worker and an API that look after lost jobs every second."""
    settings = QueueSettings(broker=server.address, prefix=PREFIX)
    deployment = Deployment(settings, tmp_path_factory.mktemp("broker"))
    with deployment.both(slots=1, ONDELETTE_RECONCILE_SECONDS="1", **SHORT) as both:
        yield both


def submit(api: httpx.Client, document: Document) -> str:
    response = api.post("/v1/jobs", json=document)
    assert response.status_code == 202, response.text
    job_id: str = response.json()["id"]
    return job_id


def read(api: httpx.Client, job_id: str) -> Document:
    job: Document = api.get(f"/v1/jobs/{job_id}").json()
    return job


def end(api: httpx.Client, job_id: str) -> tuple[str, int]:
    give_up = time.monotonic() + 60
    while time.monotonic() < give_up:
        response = api.get(f"/v1/jobs/{job_id}", params={"wait": 10})
        if response.status_code == 200 and response.json()["finished_at"] is not None:
            return response.json()["status"], response.json()["attempts"]
        time.sleep(0.1)
    pytest.fail(f"no end: {response.text}")


def test_jobs_whose_queue_is_lost_are_solved_all_the_same(
    service: tuple[Running, httpx.Client], server: DurableServer, long_job: Document, spacecraft: Document
) -> None:
    _, api = service
    busy = submit(api, long_job)
    wait_until(lambda: read(api, busy)["status"] == "running")
    small = {**spacecraft, "method": {"name": "swcm"}}
    waiting = [submit(api, small) for _ in range(5)]
    with Redis.from_url(server.address) as redis:
        wait_until(lambda: cast(int, redis.llen(PREFIX + QUEUE)) >= 3)
        redis.delete(PREFIX + QUEUE)
    api.post(f"/v1/jobs/{busy}/cancel")
    assert [end(api, job_id) for job_id in waiting] == [("succeeded", 1)] * 5


def test_a_job_that_no_worker_speaks_for_is_solved_again(
    service: tuple[Running, httpx.Client], server: DurableServer, spacecraft: Document
) -> None:
    """As if its worker had been lost together with its message."""
    _, api = service
    with Redis.from_url(server.address) as redis:
        busy = submit(api, {**spacecraft, "method": {"name": "swcm", "J": 9}})
        wait_until(lambda: read(api, busy)["status"] == "running")
        job_id = submit(api, spacecraft)
        redis.delete(PREFIX + QUEUE)
        with redis.pipeline() as pipe:
            pipe.hset(
                f"{PREFIX}job:{job_id}", mapping={"status": "running", "owner": "nobody", "attempts": 1}
            )
            pipe.hset(f"{PREFIX}job:{job_id}", "started_at", repr(time.time()))
            pipe.zrem(f"{PREFIX}queued:normal", job_id)
            pipe.zadd(f"{PREFIX}running", {job_id: time.time() + 1})
            pipe.execute()
    assert end(api, job_id) == ("succeeded", 2)
    assert end(api, busy) == ("succeeded", 1)


@pytest.mark.parametrize("away", [0.0, 4.0])
def test_a_solve_stores_its_answer_when_the_server_is_back(
    service: tuple[Running, httpx.Client], server: DurableServer, spacecraft: Document, away: float
) -> None:
    """Killed and started again on its file: nothing that was accepted is lost, nothing is solved twice."""
    worker, api = service
    running = submit(api, {**spacecraft, "method": {"name": "swcm", "J": 8}})
    small = {**spacecraft, "method": {"name": "swcm"}}
    waiting = [submit(api, small) for _ in range(3)]
    wait_until(lambda: read(api, running)["progress"] is not None)
    with ThreadPoolExecutor(1) as thread, Client(str(api.base_url)) as client:
        listener = thread.submit(lambda: list(client.events(running)))
        time.sleep(0.2)
        server.kill()
        time.sleep(away)
        server.start()
        told = [event.data["status"] for event in listener.result(60) if event.type == "status"]
    assert told == ["queued", "running", "succeeded"]
    assert [end(api, job_id) for job_id in (running, *waiting)] == [("succeeded", 1)] * 4
    result = api.get(f"/v1/jobs/{running}/result").json()
    assert (result["job_id"], result["success"]) == (running, True)
    assert worker.process.poll() is None


def test_a_worker_that_cannot_acknowledge_fetches_the_next_job_all_the_same(
    service: tuple[Running, httpx.Client], server: DurableServer, spacecraft: Document
) -> None:
    """The server is lost between the end of a job and the word that its message is done with."""
    worker, api = service
    job_id = submit(api, {**spacecraft, "method": {"name": "swcm", "J": 8}})
    wait_until(lambda: read(api, job_id)["progress"] is not None)
    worker.process.send_signal(signal.SIGSTOP)
    assert end(api, job_id) == ("succeeded", 1)
    server.kill()
    worker.process.send_signal(signal.SIGCONT)
    time.sleep(1.0)
    server.start()
    assert end(api, submit(api, {**spacecraft, "method": {"name": "swcm"}})) == ("succeeded", 1)
    assert end(api, job_id) == ("succeeded", 1)


@pytest.mark.parametrize("how", ["killed", "stopped"])
def test_the_service_says_that_the_broker_is_away_and_recovers_by_itself(
    service: tuple[Running, httpx.Client], server: DurableServer, spacecraft: Document, how: str
) -> None:
    _, api = service
    small = {**spacecraft, "method": {"name": "swcm"}}
    job_id = submit(api, small)
    assert end(api, job_id)[0] == "succeeded"
    if how == "killed":
        server.kill()
    else:
        server.signal(signal.SIGSTOP)
    asks: list[Callable[[], httpx.Response]] = [
        lambda: api.post("/v1/jobs", json=small),
        lambda: api.post("/v1/jobs", json=small, headers={"Prefer": "wait=5", "Idempotency-Key": job_id}),
        lambda: api.get(f"/v1/jobs/{job_id}"),
        lambda: api.get(f"/v1/jobs/{job_id}", params={"wait": 5}),
        lambda: api.get(f"/v1/jobs/{job_id}/result"),
        lambda: api.get("/v1/jobs"),
        lambda: api.post(f"/v1/jobs/{job_id}/cancel"),
        lambda: api.get("/readyz"),
    ]
    began = time.monotonic()
    with ThreadPoolExecutor(len(asks)) as threads:
        for refusal in threads.map(lambda ask: ask(), asks):
            problem(refusal, 503, "unavailable")
            assert int(refusal.headers["retry-after"]) >= 1
    assert time.monotonic() - began < 20
    assert api.get("/livez").status_code == 200
    if how == "killed":
        server.start()
    else:
        server.signal(signal.SIGCONT)
    wait_until(lambda: api.get("/readyz").status_code == 200)
    assert end(api, submit(api, small))[0] == "succeeded"
    with Redis.from_url(server.address) as redis:
        wait_until(lambda: not redis.hlen(f"{PREFIX}unacked"))
        assert api.get("/readyz").json()["queued"] == 0


def test_a_worker_lives_on_when_its_child_dies_before_the_server_lets_it_in(
    server: DurableServer, tmp_path: Path
) -> None:
    settings = QueueSettings(broker=server.address, prefix=f"{PREFIX}late:")
    environment = {
        **os.environ,
        **SHORT,
        "ONDELETTE_BROKER": settings.broker,
        "ONDELETTE_PREFIX": settings.prefix,
        "OMP_NUM_THREADS": "1",
    }
    log = tmp_path / "late.log"
    (notes := tmp_path / "notes").touch()
    with connect(settings) as redis:
        queue = JobQueue(redis, settings)
        redis.config_set("maxmemory", 1)
        late = Process(WORKER, ["late", str(notes)], environment, log)
        try:
            wait_until(lambda: b"Trying to reconnect" in log.read_bytes(), seconds=60)
            (child,) = late.children()
            os.kill(child, signal.SIGKILL)
            wait_until(lambda: b"SIGKILL" in log.read_bytes() or not late.alive)
            redis.config_set("maxmemory", 0)
            wait_until(lambda: bool(queue.workers()) or not late.alive)
            assert late.alive, log.read_text()
            assert late.children() not in ([], [child])
        finally:
            redis.config_set("maxmemory", 0)
            late.end()
    assert "AttributeError" not in log.read_text()
