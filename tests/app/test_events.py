"""The stream of events of a job, over a store that the test moves on itself."""

import asyncio
import json
import re
import threading
import time
from collections.abc import Callable
from typing import Any

import httpx
import pytest

import app.watch
from app.settings import Settings
from app.watch import StatusWatch
from solvers.progress import ProgressReport
from tests.problems import problem
from worker.records import FIRST, JobEvent, JobStatus, new_job_id
from worker.settings import QueueSettings
from worker.store import JobStore

MakeJob = Callable[..., str]


def read(text: str) -> list[tuple[str, str, dict[str, Any]]]:
    """The events of a stream: id, type, data."""
    found = re.findall(r"^id: (.*)\nevent: (.*)\ndata: (.*)\n$", text, re.MULTILINE)
    return [(number, kind, json.loads(data)) for number, kind, data in found]


def test_the_events_of_a_job_that_has_ended(client: httpx.Client, job: MakeJob, solved: bytes) -> None:
    job_id = job(JobStatus.SUCCEEDED, solved)
    response = client.get(f"/v1/jobs/{job_id}/events")
    assert response.status_code == 200
    assert response.headers["content-type"].partition(";")[0] == "text/event-stream"
    assert response.headers["cache-control"] == "no-store"
    assert response.headers["x-accel-buffering"] == "no"
    assert response.text.startswith("retry: ")
    events = read(response.text)
    assert [kind for _, kind, _ in events] == ["status", "status", "result", "status"]
    assert [data["status"] for _, kind, data in events if kind == "status"] == [
        "queued",
        "running",
        "succeeded",
    ]
    assert all(data["job_id"] == job_id for _, _, data in events)
    assert client.get(events[2][2]["href"]).status_code == 200
    assert events[-1][2]["at"] == client.get(f"/v1/jobs/{job_id}").json()["finished_at"]


def test_a_stream_is_taken_up_where_it_was_cut(client: httpx.Client, job: MakeJob) -> None:
    path = f"/v1/jobs/{job(JobStatus.FAILED)}/events"
    events = read(client.get(path).text)
    for place, (number, _, _) in enumerate(events[:-1]):
        response = client.get(path, headers={"Last-Event-ID": number})
        assert read(response.text) == events[place + 1 :]
    assert client.get(path, headers={"Last-Event-ID": events[-1][0]}).status_code == 204


@pytest.mark.parametrize("number", ["", "1", "x-1", "1-2-3", "-1-1", "9" * 30 + "-0"])
def test_an_id_that_we_did_not_send_is_refused(client: httpx.Client, job: MakeJob, number: str) -> None:
    response = client.get(f"/v1/jobs/{job()}/events", headers={"Last-Event-ID": number})
    problem(response, 422, "invalid-request")


def test_there_are_no_events_of_jobs_that_are_not_there(
    client: httpx.Client, job: MakeJob, store: JobStore
) -> None:
    problem(client.get(f"/v1/jobs/{new_job_id()}/events"), 404, "not-found")
    erased = job(JobStatus.SUCCEEDED)
    store.erase(erased)
    problem(client.get(f"/v1/jobs/{erased}/events"), 410, "gone")


def test_what_happens_meanwhile_is_told_at_once(client: httpx.Client, job: MakeJob, store: JobStore) -> None:
    job_id = job()

    def work() -> None:
        owner = store.start(job_id).owner
        for iteration in range(3):
            time.sleep(0.05)
            store.report(job_id, owner, ProgressReport("solve", iteration))
        store.finish(job_id, owner, JobStatus.SUCCEEDED)

    worker = threading.Timer(0.2, work)
    worker.start()
    began = time.monotonic()
    events = read(client.get(f"/v1/jobs/{job_id}/events").text)
    # Less than the time after which a listener would look by itself.
    assert time.monotonic() - began < app.watch.RECHECK - 0.5
    worker.join()
    assert [data["iteration"] for _, kind, data in events if kind == "progress"] == [0, 1, 2]
    assert [data["status"] for _, kind, data in events if kind == "status"] == [
        "queued",
        "running",
        "succeeded",
    ]


def test_many_listeners_hear_the_same(job: MakeJob, store: JobStore, queue_settings: QueueSettings) -> None:
    job_id = job()
    watch = StatusWatch(store, Settings(broker=queue_settings.broker, prefix=queue_settings.prefix))

    async def listen() -> list[JobEvent | None]:
        return [event async for event in watch.events(job_id, FIRST)]

    async def listen_all() -> list[list[JobEvent | None]]:
        idle = store.redis.info("clients")["connected_clients"]
        async with watch.running():
            listeners = [asyncio.create_task(listen()) for _ in range(200)]
            await asyncio.sleep(0.3)
            before = store.redis.info("clients")["connected_clients"]
            owner = store.start(job_id).owner
            assert store.finish(job_id, owner, JobStatus.SUCCEEDED)
            heard = await asyncio.gather(*listeners)
            assert before - idle < 60
            return heard

    heard = asyncio.run(listen_all())
    assert heard == [store.events(job_id)] * 200


def test_a_quiet_stream_says_that_it_is_still_there(
    job: MakeJob, store: JobStore, queue_settings: QueueSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(app.watch, "HEARTBEAT", 0.2)
    monkeypatch.setattr(app.watch, "RECHECK", 0.1)
    job_id = job()
    watch = StatusWatch(store, queue_settings)

    async def listen() -> list[JobEvent | None]:
        heard = []
        async for event in watch.events(job_id, FIRST):
            heard.append(event)
            if len(heard) == 3:
                store.cancel(job_id)
        return heard

    heard = asyncio.run(listen())
    assert heard[1:-1] == [None] * (len(heard) - 2)
    assert [event.data["status"] for event in heard if event is not None] == ["queued", "cancelled"]
