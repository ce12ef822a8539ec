"""The client, synchronous and asynchronous, with a real service and with a server that misbehaves."""

from __future__ import annotations

import asyncio
import io
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np
import pytest

from app.client import (
    MINIMUM_TIME,
    AsyncClient,
    Client,
    Event,
    Job,
    JobFailed,
    Problem,
    RequestRefused,
    ServerUnreachable,
    WaitTimeout,
)
from solvers.builders import library
from tests.bad_documents import FLEXIBLE_SPACECRAFT, changed

Answer = tuple[int, dict[str, str], bytes]


@pytest.fixture
def client(url: str) -> Iterator[Client]:
    with Client(url) as client:
        yield client


@pytest.fixture(scope="module")
def solved(url: str) -> dict[str, Any]:
    """A result."""
    with Client(url) as client:
        return client.solve(FLEXIBLE_SPACECRAFT)


@contextmanager
def answering(*answers: Answer | None) -> Iterator[tuple[str, list[str]]]:
    """A real HTTP server that gives these answers one after the other; ``None`` hangs up without a word."""
    left = list(answers)
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def reply(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            key = self.headers.get("Idempotency-Key", "")
            asked.append(f"{self.command} {self.path} {len(body)} {key}")
            answer = left.pop(0)
            if answer is None:
                self.close_connection = True
                return
            status, headers, content = answer
            self.send_response(status)
            for name, value in {**headers, "Content-Length": str(len(content))}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(content)

        do_GET = do_POST = do_DELETE = reply

        def log_message(self, format: str, *args: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", asked
        finally:
            server.shutdown()
            thread.join()


def test_solve_in_three_lines(client: Client) -> None:
    seen: list[Job] = []
    result = client.solve(FLEXIBLE_SPACECRAFT, on_progress=seen.append, every=0.05)
    assert result["success"] is True
    assert result["objective"] == pytest.approx(25.8661, abs=1e-3)
    assert result.at(result["final_time"]).states["theta"] == pytest.approx(np.pi / 6, abs=1e-6)
    assert seen[-1]["status"] == "succeeded"


def test_a_problem_is_solved_as_its_document(client: Client) -> None:
    problem = Problem(
        library("rigid_body"),
        final_time=(0.1, 10),
        initial_state=[0, 0],
        final_state=[1, 0],
        bounds={"u": (-1, 1)},
        objective=MINIMUM_TIME,
        method="swcm",
    )
    assert client.validate(problem)["nodes"] == 131
    result = client.solve(problem)
    assert client.spec(result["job_id"]) == problem.to_dict()
    assert result.objective == pytest.approx(2.0, abs=1e-3)  # closed form: 2 sqrt(m x_f / u)
    table = client.sweep(problem, {"/problem/final_state/x": [1, 4]})["table"]
    assert [row["objective"] for row in table] == pytest.approx([2.0, 4.0], abs=1e-3)


def test_a_job_step_by_step(client: Client) -> None:
    job = client.submit(FLEXIBLE_SPACECRAFT)
    assert job["method"] == "swcm"
    final = client.wait(job["id"], timeout=30)
    assert final["status"] == "succeeded"
    assert client.job(job["id"]) == final
    assert client.result(job["id"])["job_id"] == job["id"]
    assert client.spec(job["id"]) == FLEXIBLE_SPACECRAFT
    client.delete(job["id"])
    with pytest.raises(RequestRefused) as refusal:
        client.job(job["id"])
    assert refusal.value.status == 410


def test_the_events_of_a_job(client: Client, url: str) -> None:
    job = client.submit(changed("/method", {"name": "swcm", "J": 6}))
    live = list(client.events(job["id"]))
    assert live[0].data["status"] == "queued"
    assert live[-1].data["status"] == "succeeded"
    assert [event.type for event in live].count("result") == 1
    assert list(client.events(job["id"])) == live
    assert list(client.events(job["id"], after=live[1].id)) == live[2:]
    assert list(client.events(job["id"], after=live[-1].id)) == []
    with pytest.raises(RequestRefused) as refusal:
        next(client.events("unknown"))
    assert refusal.value.status == 404

    async def follow() -> list[Event]:
        async with AsyncClient(url) as asynchronous:
            return [event async for event in asynchronous.events(job["id"])]

    assert asyncio.run(follow()) == live


def event(number: int, status: str) -> bytes:
    return f'id: {number}-0\nevent: status\ndata: {{"status":"{status}"}}\n\n'.encode()


def test_a_stream_of_events_that_is_cut_is_taken_up_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.client_events._PAUSE", 0.0)
    cut = b"retry: 2000\n\n" + event(1, "queued") + b": still here\n\nid: 2-0\nevent: sta"
    away = (503, {"Retry-After": "0"}, b"{}")
    answers = [(200, {}, cut), away, None, (200, {}, event(2, "running") + event(3, "succeeded"))]
    with answering(*answers) as (url, asked), Client(url) as client:
        heard = list(client.events("x"))
    assert [each.data["status"] for each in heard] == ["queued", "running", "succeeded"]
    assert len(asked) == 4
    with (
        answering(*[(200, {}, b"")] * 6) as (url, _),
        Client(url) as client,
        pytest.raises(ServerUnreachable),
    ):
        list(client.events("x"))


def test_a_result_in_every_shape(client: Client, solved: dict[str, Any]) -> None:
    job = solved["job_id"]
    assert client.export(job, "csv").startswith(b"t,")
    assert "t" in np.load(io.BytesIO(client.export(job, "npz")), allow_pickle=False)
    assert client.export(job, "mat").startswith(b"MATLAB 5.0")
    assert b"<svg" in client.plot(job)
    assert client.plot(job, "png").startswith(b"\x89PNG")
    assert len(client.trajectory(job, samples=11)["t"]) == 11
    resampled = client.trajectory(job, times=[0, 0.5, 1e-3], derivatives=True)
    assert resampled["t"] == [0, 0.5, 1e-3]
    assert set(resampled["rates"]) == {"theta", "alpha", "theta_dot", "alpha_dot"}
    assert client.trajectory(job, step=10)["t"][:3] == [0, 10, 20]


def test_jobs_are_listed_over_all_pages(client: Client, solved: dict[str, Any]) -> None:
    tagged = [client.submit(changed("/tags", ["paging"]))["id"] for _ in range(3)]
    for job in tagged:
        client.wait(job)
    assert [job["id"] for job in client.jobs(tag="paging", limit=1)] == tagged[::-1]
    assert solved["job_id"] in {job["id"] for job in client.jobs(status="succeeded", method="swcm")}
    assert list(client.jobs(name="nobody")) == []


def test_a_case_is_ready_to_submit(client: Client) -> None:
    assert "flexible_spacecraft" in [case["name"] for case in client.cases()]
    sizes = client.validate(client.case("flexible_spacecraft"))
    assert sizes["nodes"] == 131


def test_a_job_can_be_cancelled_and_waiting_can_end_before_it(client: Client) -> None:
    job = client.submit(changed("/method/J", 10))
    started = time.monotonic()
    with pytest.raises(WaitTimeout) as timeout:
        client.wait(job["id"], timeout=0.3)
    assert 0.2 < time.monotonic() - started < 3
    assert timeout.value.job["id"] == job["id"]
    client.cancel(job["id"])
    assert client.wait(job["id"], timeout=10)["status"] == "cancelled"


def test_every_mistake_of_a_document_arrives(client: Client) -> None:
    document = changed("/problem/bounds/T", [5, -5])
    document["metod"] = 1
    with pytest.raises(RequestRefused) as refusal:
        client.submit(document)
    assert refusal.value.status == 422
    assert {error["pointer"] for error in refusal.value.errors} == {"/problem/bounds/T", "/metod"}
    assert refusal.value.problem["status"] == 422


def test_the_same_key_is_the_same_job(client: Client) -> None:
    first, second = (client.submit(FLEXIBLE_SPACECRAFT, idempotency_key="once") for _ in range(2))
    assert first["id"] == second["id"]


def test_the_asynchronous_client_does_the_same(url: str) -> None:
    async def several() -> list[dict[str, Any]]:
        async with AsyncClient(url) as client:
            results = await asyncio.gather(*(client.solve(FLEXIBLE_SPACECRAFT) for _ in range(3)))
            listed = [job["id"] async for job in client.jobs(limit=2)]
            assert {result["job_id"] for result in results} <= set(listed)
            with pytest.raises(RequestRefused):
                await client.job("00000000-0000-7000-8000-000000000000")
            assert (await client.trajectory(results[0]["job_id"], samples=2))["t"][0] == 0
            return results

    assert all(result["success"] for result in asyncio.run(several()))


JOB = {"id": "1", "status": "succeeded", "error": None}
OK: Answer = (200, {"Content-Type": "application/json"}, json.dumps(JOB).encode())
BUSY: Answer = (503, {"Retry-After": "0.1"}, b"{}")


def test_a_busy_service_is_asked_again_when_it_says() -> None:
    with answering(BUSY, (429, {"Retry-After": "0.2"}, b"{}"), OK) as (url, asked), Client(url) as client:
        started = time.monotonic()
        assert client.job("1") == JOB
        assert time.monotonic() - started >= 0.3
        assert len(asked) == 3


def test_a_document_is_sent_again_under_the_same_key() -> None:
    # Its first try may still be at work.
    in_flight = (409, {"Retry-After": "0.1"}, b"{}")
    with answering(BUSY, None, in_flight, OK) as (url, asked), Client(url) as client:
        client.submit({"a": 1})
        assert len(asked) == 4
        assert len(set(asked)) == 1


def test_patience_has_its_end() -> None:
    with answering(*[BUSY] * 6) as (url, asked), Client(url) as client:
        with pytest.raises(RequestRefused) as refusal:
            client.job("1")
        assert (refusal.value.status, len(asked)) == (503, 6)
    with answering((503, {"Retry-After": "3600"}, b"{}")) as (url, asked), Client(url) as client:
        with pytest.raises(RequestRefused):
            client.job("1")
        assert len(asked) == 1


def test_a_connection_that_dies_is_tried_once_more() -> None:
    with answering(OK, None, OK) as (url, asked), Client(url) as client:
        client.job("1")
        assert client.job("1") == JOB
        assert len(asked) == 3
    with answering(None, None) as (url, asked), Client(url) as client, pytest.raises(ServerUnreachable):
        client.job("1")
    assert len(asked) == 2


def test_a_service_that_starts_again_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.client_steps._growing", lambda earlier: 0.01)
    running = (200, {}, json.dumps({**JOB, "status": "running"}).encode())
    with answering(running, None, None, None, OK) as (url, asked), Client(url) as client:
        assert client.wait("1") == JOB
        assert len(asked) == 5
    with Client(url) as client:  # nobody is there any more
        client._known = True
        with pytest.raises(ServerUnreachable):
            client.job("1")


def test_the_asynchronous_client_is_as_patient() -> None:
    async def job(url: str) -> Job:
        async with AsyncClient(url) as client:
            return await client.job("1")

    with answering(BUSY, None, OK) as (url, _):
        # The hang-up comes after the busy answer: the connection has been used before.
        assert asyncio.run(job(url)) == JOB


def test_words_that_are_no_problem_document_are_survived() -> None:
    proxy = (502, {"Content-Type": "text/html"}, b"<h1>Bad gateway</h1>")
    with (
        answering(proxy) as (url, _),
        Client(url) as client,
        pytest.raises(RequestRefused, match="HTTP 502"),
    ):
        client.cases()


def test_a_job_without_a_result_says_why() -> None:
    failed = {
        "id": "1",
        "status": "failed",
        "error": {"type": "worker_lost", "detail": "the worker was lost"},
    }
    missing = (404, {}, json.dumps({"title": "No result", "status": 404}).encode())
    answers = [
        (202, {}, json.dumps({**failed, "status": "queued"}).encode()),
        (200, {}, json.dumps(failed).encode()),
    ]
    with (
        answering(*answers, missing) as (url, _),
        Client(url) as client,
        pytest.raises(JobFailed, match="job 1 failed: the worker was lost") as failure,
    ):
        client.solve({})
    assert failure.value.job["status"] == "failed"


def test_nobody_there_is_told_with_the_address() -> None:
    with Client("http://127.0.0.1:9") as client, pytest.raises(ServerUnreachable, match=r"127\.0\.0\.1:9"):
        client.cases()


def test_a_proxy_is_not_asked_for_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")
    with answering(OK) as (url, _), Client(url) as client:
        assert client.job("1") == JOB


def test_an_id_cannot_lead_elsewhere() -> None:
    with answering(OK) as (url, asked), Client(url) as client:
        client.job("../cases?x=1#y")
    assert asked == ["GET /v1/jobs/..%2Fcases%3Fx%3D1%23y 0 "]
