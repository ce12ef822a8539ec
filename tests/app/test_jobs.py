import json
import re
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from fastapi import FastAPI
from redis.exceptions import ConnectionError

from app.main import create_app
from app.settings import Settings
from solvers.spec import canonical_json
from tests.app.conftest import served
from tests.problems import problem
from worker.queue import JobQueue
from worker.records import FailureType, JobError, JobStatus, new_job_id
from worker.store import JobStore

Make = Callable[..., str]
JOB_KEYS = {
    "id",
    "name",
    "tags",
    "status",
    "method",
    "priority",
    "created_at",
    "deadline_at",
    "started_at",
    "finished_at",
    "expires_at",
    "pinned",
    "reused_from",
    "progress",
    "error",
    "attempts",
    "cancel_requested",
    "project",
    "submitted_by",
    "sweep",
    "flights_of",
    "links",
}


def test_a_document_becomes_a_queued_job(
    client: httpx.Client, queue: JobQueue, document: dict[str, Any]
) -> None:
    response = client.post("/v1/jobs", json=document)
    assert response.status_code == 202
    job = response.json()
    assert set(job) == JOB_KEYS
    assert (job["status"], job["name"], job["tags"], job["method"], job["attempts"]) == (
        "queued",
        document["name"],
        ["slew"],
        "swcm",
        0,
    )
    assert (job["started_at"], job["finished_at"], job["progress"], job["error"]) == (None, None, None, None)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", job["created_at"])
    assert response.headers["location"] == job["links"]["self"] == f"/v1/jobs/{job['id']}"
    assert int(response.headers["retry-after"]) >= 1
    assert "preference-applied" not in response.headers
    assert queue.depth() == 1
    again = client.get(response.headers["location"])
    assert again.status_code == 200
    assert again.json() == job
    assert again.headers["etag"] == response.headers["etag"]


def test_a_document_without_a_method_means_auto(client: httpx.Client, document: dict[str, Any]) -> None:
    del document["method"], document["name"]
    job = client.post("/v1/jobs", json=document).json()
    assert (job["method"], job["name"]) == ("auto", None)


def test_the_document_comes_back_letter_for_letter(client: httpx.Client, document: dict[str, Any]) -> None:
    document["notes"] = "naïve \u2028 ✓"
    body = json.dumps(document, indent=3, ensure_ascii=False).encode()
    job = client.post("/v1/jobs", content=body, headers={"Content-Type": "application/json"}).json()
    spec = client.get(job["links"]["spec"])
    assert spec.headers["content-type"] == "application/json"
    assert spec.content == body


def test_the_time_to_ask_again_grows_with_the_queue(client: httpx.Client, document: dict[str, Any]) -> None:
    document["method"]["J"] = 10
    waits = [int(client.post("/v1/jobs", json=document).headers["retry-after"]) for _ in range(4)]
    assert waits == sorted(waits)
    assert waits[-1] > waits[0]


@pytest.mark.parametrize(
    "prefer",
    ["wait=0", "respond-async, wait=0", "WAIT = 0", 'wait="0"; foo', "wait=0, wait=10"],
)
def test_a_preference_to_wait_only_delays_the_answer(
    client: httpx.Client, document: dict[str, Any], prefer: str
) -> None:
    response = client.post("/v1/jobs", json=document, headers={"Prefer": prefer})
    assert response.status_code == 202
    assert response.json()["status"] == "queued"
    assert response.headers["preference-applied"] == "wait=0"


@pytest.mark.parametrize("prefer", ["wait", "wait=soon", "wait=-1", "return=minimal", ""])
def test_a_preference_that_cannot_be_read_is_ignored(
    client: httpx.Client, document: dict[str, Any], prefer: str
) -> None:
    response = client.post("/v1/jobs", json=document, headers={"Prefer": prefer})
    assert response.status_code == 202
    assert "preference-applied" not in response.headers


class TestIdempotency:
    def test_the_same_key_and_body_give_the_same_job(
        self, client: httpx.Client, queue: JobQueue, document: dict[str, Any]
    ) -> None:
        first, second = (
            client.post("/v1/jobs", json=document, headers={"Idempotency-Key": "a key"}) for _ in range(2)
        )
        assert first.status_code == second.status_code == 202
        assert first.json()["id"] == second.json()["id"]
        assert queue.depth() == 1
        other = client.post("/v1/jobs", json=document, headers={"Idempotency-Key": "another"})
        assert other.json()["id"] != first.json()["id"]

    def test_the_same_key_with_another_body_is_refused(
        self, client: httpx.Client, queue: JobQueue, document: dict[str, Any]
    ) -> None:
        client.post("/v1/jobs", json=document, headers={"Idempotency-Key": "a key"})
        document["name"] = "another"
        response = client.post("/v1/jobs", json=document, headers={"Idempotency-Key": "a key"})
        problem(response, 422, "key-reused")
        assert queue.depth() == 1

    def test_a_key_whose_first_request_is_in_flight_is_a_conflict(
        self, app: FastAPI, client: httpx.Client, document: dict[str, Any]
    ) -> None:
        app.state.service.claims.take("a key", canonical_json(document).encode(), new_job_id())
        response = client.post("/v1/jobs", json=document, headers={"Idempotency-Key": "a key"})
        problem(response, 409, "conflict")
        assert response.headers["retry-after"] == "1"

    def test_a_body_may_be_written_in_another_way(
        self, client: httpx.Client, queue: JobQueue, document: dict[str, Any]
    ) -> None:
        headers = {"Idempotency-Key": "a key", "Content-Type": "application/json"}
        backwards = dict(reversed(document.items()))
        first, second = (
            client.post("/v1/jobs", content=json.dumps(said, indent=indent), headers=headers)
            for said, indent in ((document, None), (backwards, 3))
        )
        assert (second.status_code, second.json()["id"]) == (202, first.json()["id"])
        assert queue.depth() == 1

    def test_a_job_whose_process_ended_before_it_could_say_so_is_found_again(
        self,
        app: FastAPI,
        client: httpx.Client,
        document: dict[str, Any],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        claims = app.state.service.claims
        headers = {"Idempotency-Key": "a key"}

        def end(key: str) -> None:
            raise ConnectionError

        with monkeypatch.context() as ended:
            ended.setattr(claims, "settle", end)
            ended.setattr(claims, "release", lambda key: None)
            problem(client.post("/v1/jobs", json=document, headers=headers), 503, "unavailable")
        (made,) = client.get("/v1/jobs").json()["jobs"]
        problem(client.post("/v1/jobs", json=document, headers=headers), 409, "conflict")
        claims.release("a key")
        for _ in range(2):
            again = client.post("/v1/jobs", json=document, headers=headers)
            assert (again.status_code, again.json()["id"]) == (202, made["id"])
        assert [job["id"] for job in client.get("/v1/jobs").json()["jobs"]] == [made["id"]]

    def test_a_key_with_which_nothing_could_be_made_may_be_used_at_once(
        self,
        app: FastAPI,
        client: httpx.Client,
        document: dict[str, Any],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        def away(*arguments: object) -> None:
            raise ConnectionError

        headers = {"Idempotency-Key": "a key"}
        with monkeypatch.context() as ended:
            ended.setattr(app.state.service.store, "add", away)
            problem(client.post("/v1/jobs", json=document, headers=headers), 503, "unavailable")
        assert client.get("/v1/jobs").json()["jobs"] == []
        assert client.post("/v1/jobs", json=document, headers=headers).status_code == 202

    def test_a_refused_document_does_not_use_the_key(
        self, client: httpx.Client, document: dict[str, Any]
    ) -> None:
        good = dict(document)
        document["method"] = {"name": "swmc"}
        problem(
            client.post("/v1/jobs", json=document, headers={"Idempotency-Key": "a key"}),
            422,
            "invalid-document",
        )
        assert client.post("/v1/jobs", json=good, headers={"Idempotency-Key": "a key"}).status_code == 202

    @pytest.mark.parametrize("key", ["", "x" * 256])
    def test_a_key_has_1_to_255_characters(
        self, client: httpx.Client, document: dict[str, Any], key: str
    ) -> None:
        members = problem(
            client.post("/v1/jobs", json=document, headers={"Idempotency-Key": key}), 422, "invalid-request"
        )
        assert members["errors"][0]["parameter"] == "Idempotency-Key"

    def test_an_erased_job_is_not_made_again(
        self, client: httpx.Client, store: JobStore, document: dict[str, Any]
    ) -> None:
        job = client.post("/v1/jobs", json=document, headers={"Idempotency-Key": "a key"}).json()
        store.cancel(job["id"])
        store.erase(job["id"])
        problem(client.post("/v1/jobs", json=document, headers={"Idempotency-Key": "a key"}), 410, "gone")


def test_a_validated_document_is_not_queued(
    client: httpx.Client, queue: JobQueue, document: dict[str, Any]
) -> None:
    response = client.post("/v1/validate", json=document)
    assert response.status_code == 200
    size = response.json()
    assert (size["nodes"], size["method"]) == (131, "swcm")
    assert size["variables"] > 2 * 131
    assert size["constraints"] > 2 * 129 - 1
    assert size["seconds"] > 0
    assert queue.depth() == 0
    assert client.get("/v1/jobs").json()["jobs"] == []


def test_the_entity_tag_changes_exactly_if_the_job_does(
    client: httpx.Client, store: JobStore, job: Make
) -> None:
    job_id = job()
    first = client.get(f"/v1/jobs/{job_id}")
    etag = first.headers["etag"]
    for listed in (etag, f"W/{etag}", f'"other", {etag}', "*"):
        unchanged = client.get(f"/v1/jobs/{job_id}", headers={"If-None-Match": listed})
        assert (unchanged.status_code, unchanged.content) == (304, b"")
        assert unchanged.headers["etag"] == etag
    store.start(job_id)
    changed = client.get(f"/v1/jobs/{job_id}", headers={"If-None-Match": etag})
    assert changed.status_code == 200
    assert changed.json()["status"] == "running"
    assert changed.headers["etag"] != etag


def test_an_error_is_told_as_the_job_has_it(client: httpx.Client, store: JobStore, job: Make) -> None:
    job_id = job(JobStatus.RUNNING)
    store.fail(job_id, JobError(FailureType.TIME_LIMIT, "Title.", "Detail."))
    answer = client.get(f"/v1/jobs/{job_id}").json()
    assert answer["status"] == "failed"
    assert answer["error"] == {"type": "time_limit", "title": "Title.", "detail": "Detail."}


def test_a_wait_ends_without_news_after_its_time(client: httpx.Client, job: Make) -> None:
    response = client.get(f"/v1/jobs/{job()}", params={"wait": 0.05})
    assert response.status_code == 200
    assert response.json()["status"] == "queued"


@pytest.mark.parametrize("wait", ["-1", "soon", "nan", "inf"])
def test_a_wait_is_a_number_of_seconds(client: httpx.Client, job: Make, wait: str) -> None:
    members = problem(client.get(f"/v1/jobs/{job()}", params={"wait": wait}), 422, "invalid-request")
    assert members["errors"][0]["parameter"] == "wait"


def test_a_cancelled_queued_job_is_final_at_once_and_cancelling_again_changes_nothing(
    client: httpx.Client, job: Make
) -> None:
    job_id = job()
    first = client.post(f"/v1/jobs/{job_id}/cancel")
    assert (first.status_code, first.json()["status"]) == (202, "cancelled")
    second = client.post(f"/v1/jobs/{job_id}/cancel")
    assert (second.status_code, second.json()) == (202, first.json())


def test_a_running_job_is_asked_to_stop(client: httpx.Client, job: Make) -> None:
    answer = client.post(f"/v1/jobs/{job(JobStatus.RUNNING)}/cancel").json()
    assert (answer["status"], answer["cancel_requested"]) == ("running", True)


@pytest.mark.parametrize("status", [JobStatus.QUEUED, JobStatus.RUNNING])
def test_an_active_job_is_not_erased(client: httpx.Client, job: Make, status: JobStatus) -> None:
    problem(client.delete(f"/v1/jobs/{job(status)}"), 409, "conflict")


def test_an_erased_job_is_gone_for_every_question(client: httpx.Client, job: Make, solved: bytes) -> None:
    job_id = job(JobStatus.SUCCEEDED, solved)
    erased = client.delete(f"/v1/jobs/{job_id}")
    assert (erased.status_code, erased.content) == (204, b"")
    for method, path in questions(job_id):
        problem(client.request(method, path), 410, "gone")


def test_an_unknown_job_is_not_found_for_any_question(client: httpx.Client) -> None:
    for unknown in (new_job_id(), "abc", "%2e%2e", f"{new_job_id()}%3Adocument", "*", "%00"):
        for method, path in questions(unknown):
            problem(client.request(method, path), 404, "not-found")


def questions(job_id: str) -> list[tuple[str, str]]:
    parts = ("", "/spec", "/result", "/trajectory", "/plot.svg", "/plot.png", "/report.html", "?wait=1")
    here = f"/v1/jobs/{job_id}"
    asks = [("POST", f"{here}/cancel"), ("POST", f"{here}/pin"), ("DELETE", f"{here}/pin"), ("DELETE", here)]
    return [*asks, *(("GET", here + part) for part in parts)]


class TestList:
    def ids(self, response: Any) -> list[str]:
        assert response.status_code == 200, response.text
        return [job["id"] for job in response.json()["jobs"]]

    def test_newest_first_page_by_page(self, client: httpx.Client, job: Make) -> None:
        made = [job() for _ in range(5)]
        response = client.get("/v1/jobs", params={"limit": 2, "status": "queued"})
        seen = [self.ids(response)]
        while "next" in response.links:
            link = urlsplit(response.links["next"]["url"])
            assert not link.netloc
            assert response.json()["next_cursor"] is not None
            response = client.get(link.geturl())
            seen.append(self.ids(response))
        assert response.json()["next_cursor"] is None
        assert [len(page) for page in seen] == [2, 2, 1]
        assert [job_id for page in seen for job_id in page] == made[::-1]

    def test_filters(self, client: httpx.Client, job: Make, solved: bytes) -> None:
        plain = job()
        running = job(JobStatus.RUNNING, method="gpm", name="a & b", tags=("x", "y"))
        done = job(JobStatus.SUCCEEDED, solved, name="a & b", tags=("y",))
        for params, expected in (
            ({}, [done, running, plain]),
            ({"status": "queued"}, [plain]),
            ({"status": "succeeded"}, [done]),
            ({"status": "failed"}, []),
            ({"method": "gpm"}, [running]),
            ({"name": "a & b"}, [done, running]),
            ({"name": "a"}, []),
            ({"tag": "y"}, [done, running]),
            ({"tag": "y", "status": "running"}, [running]),
        ):
            assert self.ids(client.get("/v1/jobs", params=params)) == expected, params

    @pytest.mark.parametrize(
        ("name", "value"),
        [
            ("limit", "0"),
            ("limit", "101"),
            ("limit", "many"),
            ("status", "lost"),
            ("cursor", "abc"),
            ("cursor", "%"),
            ("cursor", "\u2713"),
            ("cursor", "x" * 5_000),
        ],
    )
    def test_wrong_parameters_are_named(self, client: httpx.Client, name: str, value: str) -> None:
        members = problem(client.get("/v1/jobs", params={name: value}), 422, "invalid-request")
        assert members["errors"][0]["parameter"] == name


def test_without_a_broker_everything_that_needs_it_is_unavailable(document: dict[str, Any]) -> None:
    with served(create_app(Settings(broker="unix:///nowhere/at/all.sock"))) as client:
        assert client.get("/livez").status_code == 200
        assert client.post("/v1/validate", json=document).status_code == 200
        for response in (
            client.get("/readyz"),
            client.get("/v1/jobs"),
            client.get(f"/v1/jobs/{new_job_id()}", params={"wait": 1}),
            client.post("/v1/jobs", json=document),
            client.post("/v1/jobs", json=document, headers={"Idempotency-Key": "a key"}),
            client.post(f"/v1/jobs/{new_job_id()}/cancel"),
        ):
            problem(response, 503, "unavailable")
            assert int(response.headers["retry-after"]) >= 1
