"""Who may do what: keys, scopes, projects, rates, quotas."""

from __future__ import annotations

import logging
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from redis import Redis

from app.auth import needed_scope
from app.main import create_app
from app.settings import Settings
from tests.acceptance.conftest import wait_until
from tests.app.conftest import served
from tests.problems import problem
from tests.servers import DurableServer
from worker.keys import KeyStore, Scope
from worker.records import JobStatus
from worker.settings import QueueSettings
from worker.store import JobStore, connect

JOB = "01a20748-a63b-7ec7-b324-a66bfbc20fd7"
Document = dict[str, Any]
MakeKey = Callable[..., dict[str, str]]


@pytest.fixture
def keys(redis: Redis, queue_settings: QueueSettings) -> KeyStore:
    return KeyStore(redis, queue_settings)


@pytest.fixture
def key(keys: KeyStore) -> MakeKey:
    """Make a key; returns the headers that carry it."""

    def make(*scopes: str, project: str = "slews") -> dict[str, str]:
        chosen = map(Scope, scopes or ("submit", "read", "cancel"))
        return {"Authorization": f"Bearer {keys.create('Ada', project, chosen)[1]}"}

    return make


@pytest.fixture
def settings(queue_settings: QueueSettings) -> Settings:
    return Settings(broker=queue_settings.broker, prefix=queue_settings.prefix, key_cache_seconds=0.0)


@pytest.fixture
def client(settings: Settings) -> Iterator[httpx.Client]:
    with served(create_app(settings)) as client:
        yield client


def every_route() -> list[tuple[str, str]]:
    described = create_app(Settings(broker="redis://nowhere")).openapi()["paths"]
    listed = sorted(
        (method.upper(), re.sub(r"\{[a-z_]+\}", JOB, path))
        for path, operations in described.items()
        for method in operations
    )
    return [*listed, ("GET", "/"), ("GET", "/docs"), ("GET", "/v1"), ("PUT", "/v1/nothing")]


PUBLIC = {"/", "/docs", "/livez", "/readyz"}


@pytest.mark.parametrize(("method", "path"), every_route())
def test_no_route_is_open_by_mistake(client: httpx.Client, key: MakeKey, method: str, path: str) -> None:
    key()
    if path in PUBLIC or path.startswith("/problems/"):
        assert needed_scope(method, path) is None
        assert client.request(method, path).status_code != 401
        return
    members = problem(client.request(method, path), 401, "unauthorized")
    assert "Bearer" in members["detail"]


def test_as_long_as_there_is_no_key_there_is_one_owner(client: httpx.Client, document: Document) -> None:
    job = client.post("/v1/jobs", json=document).json()
    assert (job["project"], job["submitted_by"]) == ("default", None)
    assert client.get("/metrics").status_code == 200


def test_from_the_first_key_on_nobody_enters_without(
    client: httpx.Client, key: MakeKey, keys: KeyStore
) -> None:
    assert client.get("/v1/jobs").status_code == 200
    headers = key()
    response = client.get("/v1/jobs")
    problem(response, 401, "unauthorized")
    assert response.headers["www-authenticate"].startswith("Bearer")
    assert client.get("/v1/jobs", headers=headers).status_code == 200
    # That the last key is revoked opens nothing.
    keys.revoke(keys.list()[0].id)
    problem(client.get("/v1/jobs", headers=headers), 401, "unauthorized")
    problem(client.get("/v1/jobs"), 401, "unauthorized")


@pytest.mark.parametrize(
    "header",
    [
        "",
        "Bearer",
        "Bearer ",
        "Basic b25kOg==",
        "Bearer ond_000000000000_" + "a" * 43,
        "Bearer \x00",
        "ond_1",
    ],
)
def test_a_wrong_key(client: httpx.Client, key: MakeKey, header: str) -> None:
    key()
    response = client.get("/v1/jobs", headers={"Authorization": header.encode("latin-1")})  # type: ignore[dict-item]
    problem(response, 401, "unauthorized")
    assert "000000" not in response.text


def test_every_scope_allows_its_own(client: httpx.Client, key: MakeKey, document: Document) -> None:
    job = client.post("/v1/jobs", json=document, headers=key("submit")).json()
    asked = {
        "submit": ("POST", "/v1/validate", document),
        "read": ("GET", f"/v1/jobs/{job['id']}", None),
        "cancel": ("POST", f"/v1/jobs/{job['id']}/cancel", None),
        "metrics": ("GET", "/metrics", None),
    }
    for scope in (*asked, "admin"):
        headers = key(scope)
        for needed, (method, path, body) in asked.items():
            response = client.request(method, path, json=body, headers=headers)
            if scope in (needed, "admin"):
                assert response.is_success, (scope, needed, response.text)
            else:
                assert needed in problem(response, 403, "forbidden")["detail"]
                assert "ratelimit" in response.headers
    problem(client.delete(f"/v1/jobs/{job['id']}", headers=key("read", "submit")), 403, "forbidden")


def test_other_projects_jobs_are_not_there(
    client: httpx.Client, key: MakeKey, store: JobStore, document: Document, solved: bytes
) -> None:
    mine, other = key("admin"), key("admin", project="rockets")
    job = client.post("/v1/jobs", json=document, headers=mine).json()
    assert job["project"] == "slews"
    owner = store.start(job["id"]).owner
    store.finish(job["id"], owner, JobStatus.SUCCEEDED, result=solved)
    here = f"/v1/jobs/{job['id']}"
    for method, path in (
        ("GET", here),
        ("GET", f"{here}/spec"),
        ("GET", f"{here}/result"),
        ("GET", f"{here}/events"),
        ("GET", f"{here}/bundle.zip"),
        ("GET", f"{here}/plot.svg"),
        ("GET", f"{here}/report.html"),
        ("GET", f"{here}/trajectory"),
        ("POST", f"{here}/cancel"),
        ("DELETE", here),
    ):
        refused = problem(client.request(method, path, headers=other), 404, "not-found")
        unknown = client.request(method, path.replace(job["id"], JOB), headers=other)
        assert refused["detail"] == problem(unknown, 404, "not-found")["detail"]
    assert client.get("/v1/jobs", headers=other).json()["jobs"] == []
    assert [found["id"] for found in client.get("/v1/jobs", headers=mine).json()["jobs"]] == [job["id"]]
    # Nor are they a way around: to start from, or to take the answer of.
    for path in ("/v1/jobs", "/v1/validate"):
        response = client.post(path, json={**document, "warm_start": job["id"]}, headers=other)
        assert problem(response, 422, "invalid-document")["errors"][0]["pointer"] == "/warm_start"
    assert client.post("/v1/jobs", json={**document, "warm_start": job["id"]}, headers=mine).is_success
    reused = client.post("/v1/jobs", json={**document, "reuse": True}, headers=other).json()
    assert reused["status"] == "queued"
    assert client.delete(here, headers=mine).status_code == 204
    problem(client.get(here, headers=mine), 410, "gone")
    problem(client.get(here, headers=other), 404, "not-found")


def test_other_projects_sweeps_are_not_there(client: httpx.Client, key: MakeKey, document: Document) -> None:
    mine, other = key("admin"), key("admin", project="rockets")
    body = {"document": document, "grid": {"/problem/model/parameters/k": [90, 110]}}
    sweep = client.post("/v1/sweeps", json=body, headers=mine).json()
    for path in ("", "/result?format=csv"):
        problem(client.get(sweep["links"]["self"] + path, headers=other), 404, "not-found")
        assert client.get(sweep["links"]["self"] + path, headers=mine).is_success
    problem(client.post(sweep["links"]["cancel"], headers=other), 404, "not-found")
    assert len(client.get("/v1/jobs", headers=mine).json()["jobs"]) == 2
    assert client.get(sweep["table"][0]["href"], headers=mine).json()["project"] == "slews"


def test_an_idempotency_key_counts_for_its_api_key(
    client: httpx.Client, key: MakeKey, document: Document
) -> None:
    first, second = key(), key()
    jobs = [
        client.post("/v1/jobs", json=document, headers={**headers, "Idempotency-Key": "once"}).json()["id"]
        for headers in (first, first, second)
    ]
    assert jobs[0] == jobs[1] != jobs[2]
    submitted_by = client.get(f"/v1/jobs/{jobs[0]}", headers=second).json()["submitted_by"]
    assert submitted_by in first["Authorization"]


def test_a_page_holds_the_projects_own_jobs(client: httpx.Client, key: MakeKey, document: Document) -> None:
    mine, other = key(), key(project="rockets")
    for headers in (mine, other, mine, other, mine):
        client.post("/v1/jobs", json=document, headers=headers)
    page = client.get("/v1/jobs", params={"limit": 2}, headers=mine).json()
    following = client.get("/v1/jobs", params={"cursor": page["next_cursor"]}, headers=mine).json()
    listed = page["jobs"] + following["jobs"]
    assert len(listed) == 3
    assert {job["project"] for job in listed} == {"slews"}


def test_rates(
    settings: Settings, key: MakeKey, document: Document, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "ondelette.access")
    limited = settings.model_copy(update={"submit_rate": 3, "request_rate": 5})
    mine, other = key(), key()
    with served(create_app(limited)) as client:
        answers = [client.post("/v1/validate", json=document, headers=mine) for _ in range(4)]
        assert [answer.status_code for answer in answers] == [200, 200, 200, 429]
        assert answers[0].headers["ratelimit-policy"] == '"submit";q=3;w=60'
        assert re.fullmatch(r'"submit";r=2;t=\d+', answers[0].headers["ratelimit"])
        problem(answers[3], 429, "rate-limited")
        assert 1 <= int(answers[3].headers["retry-after"]) <= 21
        assert answers[3].headers["ratelimit"].startswith('"submit";r=0;')
        # The operator sees who it is that asks too often.
        assert caplog.records[-1].status == 429  # type: ignore[attr-defined]
        assert caplog.records[-1].key in mine["Authorization"]  # type: ignore[attr-defined]
        # Reading has a bucket of its own, and so has everybody else.
        assert client.get("/v1/jobs", headers=mine).headers["ratelimit-policy"] == '"request";q=5;w=60'
        assert client.post("/v1/validate", json=document, headers=other).status_code == 200
        assert "ratelimit" not in client.get("/livez").headers


def test_a_project_has_its_share(
    settings: Settings, key: MakeKey, store: JobStore, document: Document
) -> None:
    mine, other = key(), key(project="rockets")
    with served(create_app(settings.model_copy(update={"project_jobs": 2}))) as client:
        jobs = [client.post("/v1/jobs", json=document, headers=mine).json()["id"] for _ in range(2)]
        response = client.post("/v1/jobs", json=document, headers=mine)
        assert "at most 2" in problem(response, 429, "quota-exceeded")["detail"]
        assert int(response.headers["retry-after"]) > 0
        assert client.post("/v1/jobs", json=document, headers=other).status_code == 202
        store.cancel(jobs[0])
        assert client.post("/v1/jobs", json=document, headers=mine).status_code == 202
        body = {"document": document, "grid": {"/problem/model/parameters/k": [90, 100, 110]}}
        refused = problem(client.post("/v1/sweeps", json=body, headers=other), 429, "quota-exceeded")
        assert "3 more" in refused["detail"]


def test_a_full_queue(settings: Settings, document: Document) -> None:
    with served(create_app(settings.model_copy(update={"queued_jobs": 1}))) as client:
        job = client.post("/v1/jobs", json=document).json()
        response = client.post("/v1/jobs", json=document)
        problem(response, 503, "queue-full")
        assert int(response.headers["retry-after"]) > 0
        client.post(job["links"]["cancel"])
        assert client.post("/v1/jobs", json=document).status_code == 202


class TestBootstrap:
    def test_the_key_in_the_file_opens_everything(self, settings: Settings, tmp_path: Path) -> None:
        file = tmp_path / "key"
        file.write_text("s" * 32 + "\n")
        with served(create_app(settings.model_copy(update={"bootstrap_key_file": file}))) as client:
            problem(client.get("/v1/jobs"), 401, "unauthorized")
            for path in ("/v1/jobs", "/metrics"):
                assert client.get(path, headers={"Authorization": f"bearer {'s' * 32}"}).status_code == 200
            problem(
                client.get("/v1/jobs", headers={"Authorization": f"Bearer {'s' * 33}"}), 401, "unauthorized"
            )

    @pytest.mark.parametrize("text", ["", "short", "two words of more than thirty-two letters", "é" * 40])
    def test_a_weak_one_is_refused(self, settings: Settings, tmp_path: Path, text: str) -> None:
        file = tmp_path / "key"
        file.write_text(text)
        with pytest.raises(ValueError, match="at least 32"):
            create_app(settings.model_copy(update={"bootstrap_key_file": file}))


def test_where_keys_are_asked_for_none_is_not_enough(settings: Settings) -> None:
    away = settings.model_copy(update={"require_keys": True, "broker": "unix:///nowhere/at/all.sock"})
    with served(create_app(away)) as client:
        problem(client.get("/v1/models"), 401, "unauthorized")
    with served(create_app(settings.model_copy(update={"require_keys": True}))) as client:
        problem(client.get("/v1/jobs"), 401, "unauthorized")
        assert client.get("/livez").status_code == 200


def test_no_key_is_let_in_while_the_store_is_away() -> None:
    with served(create_app(Settings(broker="unix:///nowhere/at/all.sock"))) as client:
        problem(client.get("/v1/jobs"), 503, "unavailable")
        assert client.get("/v1/models").status_code == 200
        assert client.get("/livez").status_code == 200


@pytest.fixture
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DurableServer]:
    """A server of the test's own."""
    # Not pytest's own directory: a socket's path may have about 100 characters at most.
    with tempfile.TemporaryDirectory(prefix="ondelette-") as directory:
        server = DurableServer(Path(directory), fsync="no")
        server.start()
        yield server
        server.kill()


def test_a_server_without_room_is_read_and_room_can_be_made(
    server: DurableServer, document: Document, solved: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    settings = Settings(broker=server.address, key_cache_seconds=0.0)
    with connect(settings) as redis, served(create_app(settings)) as client:
        headers = {"Authorization": f"Bearer {KeyStore(redis, settings).create('A', 'p', [Scope.ADMIN])[1]}"}
        store = JobStore(redis, settings)
        waiting, ended = (
            client.post("/v1/jobs", json=document, headers=headers).json()["id"] for _ in range(2)
        )
        store.finish(ended, store.start(ended).owner, JobStatus.SUCCEEDED, result=solved)
        redis.config_set("maxmemory", 1)
        response = client.post("/v1/jobs", json=document, headers=headers)
        assert "nothing was accepted" in problem(response, 503, "unavailable")["detail"]
        assert int(response.headers["retry-after"]) > 0
        for path in ("/v1/jobs", f"/v1/jobs/{ended}", f"/v1/jobs/{ended}/result"):
            assert client.get(path, headers=headers).status_code == 200
        cancelled = client.post(f"/v1/jobs/{waiting}/cancel", headers=headers)
        assert cancelled.json()["status"] == "cancelled"
        for job_id in (waiting, ended):
            assert client.delete(f"/v1/jobs/{job_id}", headers=headers).status_code == 204
            problem(client.get(f"/v1/jobs/{job_id}", headers=headers), 410, "gone")
        redis.config_set("maxmemory", 0)
        # A disk that cannot be written to: here where its file would be, there is a folder.
        job_id = client.post("/v1/jobs", json=document, headers=headers).json()["id"]
        (Path(redis.config_get("dir")["dir"]) / "dump.rdb" / "in the way").mkdir(parents=True)
        redis.config_set("save", "3600 1")
        redis.bgsave()
        wait_until(lambda: redis.info("persistence")["rdb_last_bgsave_status"] == "err")
        caplog.clear()
        response = client.post("/v1/jobs", json=document, headers=headers)
        assert "cannot write" in problem(response, 503, "unavailable")["detail"]
        assert "MISCONF" in caplog.text
        assert "inertia" not in caplog.text
        assert client.get(f"/v1/jobs/{job_id}/spec", headers=headers).json() == document


def test_a_submission_that_the_server_may_have_taken_is_not_said_to_be_lost(
    server: DurableServer, document: Document
) -> None:
    with served(create_app(Settings(broker=server.address, key_cache_seconds=600.0))) as client:
        assert client.get("/v1/jobs").status_code == 200
        server.kill()
        detail = problem(client.post("/v1/jobs", json=document), 503, "unavailable")["detail"]
        assert "may have been taken" in detail
        assert "Idempotency-Key" in detail
        assert problem(client.get("/v1/jobs"), 503, "unavailable")["detail"] == "The broker does not answer."
