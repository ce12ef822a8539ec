"""Every refusal is problem+json with a request id, those of the framework too."""

import json
import logging
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from app.main import create_app
from app.problems import PROBLEMS
from app.settings import Settings
from tests.app.conftest import served
from tests.problems import problem
from worker.queue import JobQueue
from worker.records import JobStatus, new_job_id
from worker.settings import QueueSettings

JSON = {"Content-Type": "application/json"}


def test_an_unknown_address(client: httpx.Client) -> None:
    for path in ("/nothing", "/v1", "/v1/jobs/", "/v1/jobs/a/b", "/v1/jobs/a/plot.gif", "/v2/jobs"):
        problem(client.get(path), 404, "not-found")


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("PUT", "/v1/jobs", "GET, HEAD, POST"),
        ("PATCH", "/v1/jobs/abc", "GET, HEAD, DELETE"),
        ("GET", "/v1/jobs/abc/cancel", "POST"),
        ("POST", "/livez", "GET, HEAD"),
        ("DELETE", "/", "GET, HEAD"),
    ],
)
def test_a_method_that_an_address_does_not_have(
    client: httpx.Client, method: str, path: str, allowed: str
) -> None:
    response = client.request(method, path)
    problem(response, 405, "method-not-allowed")
    assert response.headers["allow"] == allowed


@pytest.mark.parametrize(
    "headers",
    [
        {"Content-Type": "text/plain"},
        {"Content-Type": "application/x-www-form-urlencoded"},
        {"Content-Type": "application/yaml"},
        {"Content-Type": "application/json; charset=latin-1"},
        {"Content-Type": "application/json", "Content-Encoding": "gzip"},
        {"Content-Type": "nonsense"},
        {"Content-Type": ""},
        {},
    ],
)
@pytest.mark.parametrize("path", ["/v1/jobs", "/v1/validate"])
def test_what_does_not_say_that_it_is_json(client: httpx.Client, path: str, headers: dict[str, str]) -> None:
    problem(client.post(path, content=b"{}", headers=headers), 415, "unsupported-media-type")


@pytest.mark.parametrize(
    "kind", ["application/json", "Application/JSON; charset=UTF-8", "application/ondelette+json"]
)
def test_what_says_that_it_is_json(client: httpx.Client, document: dict[str, Any], kind: str) -> None:
    body = json.dumps(document).encode()
    assert client.post("/v1/validate", content=body, headers={"Content-Type": kind}).status_code == 200


def test_a_document_with_many_mistakes(
    client: httpx.Client, queue: JobQueue, document: dict[str, Any]
) -> None:
    marker = "secret-that-is-not-sent-back"
    document["problem"]["model"]["mass"] = [[f"'{marker}' + {n}" for n in range(3)] for _ in range(3)]
    document["metod"] = marker
    response = client.post("/v1/jobs", json=document)
    members = problem(response, 422, "invalid-document")
    assert marker not in response.text
    assert len(response.content) < 20_000
    assert all(set(error) == {"pointer", "detail", "type"} for error in members["errors"])
    assert "/metod" in {error["pointer"] for error in members["errors"]}
    assert queue.depth() == 0


def test_at_most_fifty_mistakes_are_listed_and_all_are_counted(
    client: httpx.Client, document: dict[str, Any]
) -> None:
    document["problem"]["bounds"] = {f"x{number}": [0, 1] for number in range(73)}
    members = problem(client.post("/v1/jobs", json=document), 422, "invalid-document")
    assert len(members["errors"]) == 50
    assert "73" in members["detail"]


def test_a_long_key_is_not_sent_back_at_length(client: httpx.Client, document: dict[str, Any]) -> None:
    document["k" * 500_000] = 1
    response = client.post("/v1/jobs", json=document)
    problem(response, 422, "invalid-document")
    assert len(response.content) < 10_000


def test_what_this_version_does_not_do_is_told_apart(client: httpx.Client, document: dict[str, Any]) -> None:
    document["problem"]["phases"] = [{"name": "slew"}]
    document["method"] = {"name": "ga"}
    members = problem(client.post("/v1/validate", json=document), 422, "unsupported")
    assert {error["type"] for error in members["errors"]} == {"unsupported"}


@pytest.mark.parametrize("length", [1025, 5000])
@pytest.mark.parametrize("announced", [True, False])
def test_a_body_over_the_limit(queue_settings: QueueSettings, length: int, announced: bool) -> None:
    settings = Settings(broker=queue_settings.broker, prefix=queue_settings.prefix, body_bytes=1024)
    body = b'{"notes": "' + b"x" * (length - 13) + b'"}'
    assert len(body) == length
    headers = dict(JSON) if announced else {**JSON, "Transfer-Encoding": "chunked"}
    with served(create_app(settings)) as client:
        response = client.post("/v1/jobs", content=body, headers=headers)
        assert "1,024 bytes" in problem(response, 413, "too-large")["detail"]
        exactly = body[:1022] + b'"}'
        problem(client.post("/v1/jobs", content=exactly, headers=JSON), 422, "invalid-document")


class TestHosts:
    @pytest.mark.parametrize("host", ["localhost", "LOCALHOST:8000", "127.0.0.1:1", "[::1]", "[::1]:8000"])
    def test_loopback_names_are_allowed(self, client: httpx.Client, host: str) -> None:
        assert client.get("/livez", headers={"Host": host}).status_code == 200

    @pytest.mark.parametrize(
        "host",
        ["evil.example", "localhost.evil.example", "evil.example:8000", "", "localhost:80<b>", "[::2]"],
    )
    def test_any_other_name_is_refused(self, client: httpx.Client, host: str) -> None:
        response = client.get("/livez", headers={"Host": host})
        problem(response, 400, "invalid-host")
        assert "evil" not in response.text

    def test_the_operator_may_add_names(self, queue_settings: QueueSettings) -> None:
        for allowed, host, status in (
            ("api, Ondelette.example", "ondelette.example:8000", 200),
            ("api", "other.example", 400),
            ("*", "other.example", 200),
        ):
            settings = Settings(broker=queue_settings.broker, allowed_hosts=allowed)  # type: ignore[arg-type]
            with served(create_app(settings)) as client:
                assert client.get("/livez", headers={"Host": host}).status_code == status


class TestRequestId:
    def test_a_plain_one_is_kept(self, client: httpx.Client) -> None:
        response = client.get("/nothing", headers={"X-Request-Id": "run-7_a.b"})
        assert problem(response, 404, "not-found")["request_id"] == "run-7_a.b"

    @pytest.mark.parametrize("given", ["", "a b", "x" * 65, "<script>", "a\u00e9".encode().decode("latin-1")])
    def test_any_other_is_replaced(self, client: httpx.Client, given: str) -> None:
        response = client.get("/livez", headers={"X-Request-Id": given.encode("latin-1")})  # type: ignore[dict-item]
        assert len(response.headers["x-request-id"]) == 32

    def test_each_request_has_its_own(self, client: httpx.Client) -> None:
        assert len({client.get("/livez").headers["x-request-id"] for _ in range(5)}) == 5


def test_every_answer_has_the_security_headers(client: httpx.Client, document: dict[str, Any]) -> None:
    job = client.post("/v1/jobs", json=document)
    for response in (
        job,
        client.get("/"),
        client.get("/docs"),
        client.get("/nothing"),
        client.get("/v1/jobs"),
        client.get(job.headers["location"], headers={"If-None-Match": job.headers["etag"]}),
    ):
        assert response.headers["x-content-type-options"] == "nosniff"
        assert "default-src 'none'" in response.headers["content-security-policy"]
        assert "frame-ancestors 'none'" in response.headers["content-security-policy"]
        # Of no job: the page, which browsers may keep as long as they ask whether it is still the same.
        kept = ("no-cache",) if response.url.path == "/" else ("no-store", "private, no-cache")
        assert response.headers["cache-control"] in kept


@pytest.fixture
def failing(app: FastAPI) -> Iterator[httpx.Client]:
    """The application with one more route, which fails."""

    @app.get("/failure")
    def failure() -> None:
        raise ZeroDivisionError("a detail for the log only")

    with served(app) as client:
        yield client


def test_what_nobody_expected(failing: httpx.Client, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.ERROR):
        response = failing.get("/failure", headers={"X-Request-Id": "find-me"})
    problem(response, 500, "internal")
    assert "a detail for the log only" not in response.text
    assert response.headers["x-content-type-options"] == "nosniff"
    assert "find-me" in caplog.text
    assert "a detail for the log only" in caplog.text
    assert failing.get("/livez").status_code == 200


@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_every_problem_type_resolves_to_an_explanation(client: httpx.Client, name: str) -> None:
    response = client.get(f"/problems/{name}")
    assert response.status_code == 200
    assert response.headers["content-type"].startswith("text/plain")
    assert PROBLEMS[name].explanation in response.text
    assert 400 <= PROBLEMS[name].status < 600


def test_an_unknown_problem_type(client: httpx.Client) -> None:
    problem(client.get("/problems/no-such"), 404, "not-found")


def test_whatever_can_be_read_can_be_asked_for_its_headers_alone(
    client: httpx.Client, job: Callable[..., str], solved: bytes
) -> None:
    job_id = job(JobStatus.SUCCEEDED, solved)
    paths = {
        path.format(job_id=job_id, name="flexible_spacecraft", sweep_id=new_job_id())
        for path, operations in client.get("/openapi.json").json()["paths"].items()
        if "get" in operations
    }
    for path in sorted(paths | {"/", "/openapi.json", "/nowhere", f"/v1/jobs/{job_id}/cancel"}):
        read, asked = client.get(path), client.head(path)
        assert (asked.status_code, asked.content) == (read.status_code, b""), path
        of_read, of_asked = ({**answer.headers, "x-request-id": ""} for answer in (read, asked))
        assert of_asked.items() <= of_read.items(), path
        # The length of what is streamed is known when it has been.
        assert of_read.keys() - of_asked.keys() <= {"content-length"}, path


def test_the_headers_of_a_stream_are_no_stream(client: httpx.Client, job: Callable[..., str]) -> None:
    """The job never starts, so its events never end."""
    response = client.head(f"/v1/jobs/{job()}/events")
    assert response.headers["content-type"].partition(";")[0] == "text/event-stream"
    assert response.content == b""
