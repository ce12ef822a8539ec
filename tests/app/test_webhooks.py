"""Webhooks against a real receiver, read by the reference implementation of their standard."""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest
from standardwebhooks.webhooks import Webhook, WebhookVerificationError

from app.egress import AddressRefused, is_allowed, networks_of, post
from app.main import create_app
from app.settings import Settings
from app.webhooks import Webhooks, read_secrets
from tests.app.conftest import served
from tests.problems import problem
from worker.hooks import HookList
from worker.records import FailureType, JobError, JobStatus
from worker.settings import QueueSettings
from worker.store import JobStore

SECRET = "whsec_" + base64.b64encode(b"0123456789abcdef01234567").decode()
OLDER = "whsec_" + base64.b64encode(b"abcdefghijklmnopqrstuvwx").decode()
LOOPBACK = networks_of(["127.0.0.0/8"])
Received = list[tuple[dict[str, str], bytes]]


class Receiver:
    """Somebody who is told; ``answers`` are the statuses that he answers with, 204 after the last."""

    def __init__(self) -> None:
        self.received: Received = []
        self.answers: list[int] = []
        receiver = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                receiver.received.append((dict(self.headers), body))
                self.send_response(receiver.answers.pop(0) if receiver.answers else 204)
                self.send_header("Location", "/elsewhere")
                self.end_headers()

            def log_message(self, format: str, *args: Any) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/told?by=us"


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    receiver = Receiver()
    thread = threading.Thread(target=receiver.server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield receiver
    receiver.server.shutdown()
    receiver.server.server_close()
    thread.join()


@pytest.fixture
def hooks(store: JobStore) -> HookList:
    return store.hooks


@pytest.fixture
def secrets(tmp_path: Path) -> Path:
    file = tmp_path / "secrets"
    file.write_text(f"{SECRET}\n{OLDER}\n")
    return file


@pytest.fixture
def webhooks(store: JobStore, secrets: Path) -> Webhooks:
    return Webhooks(store, store.hooks, read_secrets(secrets), LOOPBACK, pauses=(0.05, 0.05, 0.05))


def sent_after(webhooks: Webhooks, receiver: Receiver, count: int) -> None:
    give_up = time.monotonic() + 10
    while len(receiver.received) < count:
        webhooks.send_due()
        assert time.monotonic() < give_up
        time.sleep(0.02)


def test_the_end_of_a_job_is_told(
    webhooks: Webhooks, receiver: Receiver, store: JobStore, job: Callable[..., str]
) -> None:
    job_id = job(webhook=receiver.url, name="A slew")
    webhooks.send_due()
    assert receiver.received == []
    owner = store.start(job_id).owner
    store.finish(job_id, owner, JobStatus.FAILED, JobError(FailureType.INFEASIBLE, "None.", "Nothing found."))
    sent_after(webhooks, receiver, 1)
    headers, body = receiver.received[0]
    for secret in (SECRET, OLDER):
        told = Webhook(secret).verify(body, {key.lower(): value for key, value in headers.items()})
        assert told["type"] == "job.failed"
        assert told["data"]["id"] == job_id
        assert told["data"]["error"]["type"] == "infeasible"
    with pytest.raises(WebhookVerificationError):
        Webhook(SECRET).verify(body + b" ", {key.lower(): value for key, value in headers.items()})
    assert headers["host"] == receiver.url.split("/")[2]
    time.sleep(0.6)
    webhooks.send_due()
    assert len(receiver.received) == 1


def test_a_message_is_sent_until_it_is_taken(
    webhooks: Webhooks, receiver: Receiver, job: Callable[..., str], hooks: HookList
) -> None:
    # A redirection is not followed: it could lead anywhere.
    receiver.answers = [500, 302, 429]
    job(JobStatus.SUCCEEDED, webhook=receiver.url)
    sent_after(webhooks, receiver, 4)
    assert {headers["webhook-id"] for headers, _ in receiver.received} == {
        receiver.received[0][0]["webhook-id"]
    }
    time.sleep(0.1)
    webhooks.send_due()
    assert len(receiver.received) == 4


@pytest.mark.parametrize(("answers", "count"), [([410], 1), ([500] * 9, 4)])
def test_it_is_given_up(
    webhooks: Webhooks, receiver: Receiver, job: Callable[..., str], answers: list[int], count: int
) -> None:
    receiver.answers = answers
    job(JobStatus.CANCELLED, webhook=receiver.url)
    sent_after(webhooks, receiver, count)
    for _ in range(5):
        time.sleep(0.06)
        webhooks.send_due()
    assert len(receiver.received) == count


def test_two_processes_send_one_message(
    webhooks: Webhooks, receiver: Receiver, job: Callable[..., str]
) -> None:
    for _ in range(5):
        job(JobStatus.SUCCEEDED, webhook=receiver.url)
    threads = [threading.Thread(target=webhooks.send_due) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({headers["webhook-id"] for headers, _ in receiver.received}) == len(receiver.received) == 5


def test_an_erased_job_is_not_told_of(
    webhooks: Webhooks, receiver: Receiver, store: JobStore, job: Callable[..., str], hooks: HookList
) -> None:
    store.erase(job(JobStatus.SUCCEEDED, webhook=receiver.url))
    webhooks.send_due()
    assert receiver.received == []
    assert hooks.take() == []


@pytest.mark.parametrize(
    "address",
    [
        "127.0.0.1",
        "127.9.9.9",
        "0.0.0.0",
        "10.1.2.3",
        "172.16.0.1",
        "192.168.1.1",
        "169.254.169.254",
        "100.64.0.1",
        "198.18.0.1",
        "224.0.0.1",
        "240.0.0.1",
        "255.255.255.255",
        "::",
        "::1",
        "fe80::1",
        "fe80::1%eth0",
        "fc00::1",
        "ff02::1",
        "::ffff:127.0.0.1",
        "::ffff:169.254.169.254",
        "64:ff9b::a9fe:a9fe",
        "2002:7f00:1::",
        "2001:0:4136:e378:8000:63bf:3fff:fdd2",
    ],
)
def test_addresses_that_are_not_public(address: str) -> None:
    assert not is_allowed(address)


@pytest.mark.parametrize(
    "address", ["93.184.215.14", "2606:2800:21f:cb07:6820:80da:af6b:8b2c", "::ffff:8.8.8.8"]
)
def test_addresses_that_are_public(address: str) -> None:
    assert is_allowed(address)


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "localhost", "0x7f.1", "2130706433", "[::1]", "[::ffff:7f00:1]"]
)
def test_this_machine_is_not_reached_under_any_name(receiver: Receiver, host: str) -> None:
    url = receiver.url.replace("127.0.0.1", host)
    with pytest.raises(AddressRefused):
        post(url, b"", [("host", "x")], (), 2.0)
    assert receiver.received == []


class TestOverHttp:
    @pytest.fixture
    def settings(self, queue_settings: QueueSettings, secrets: Path) -> Settings:
        return Settings(
            broker=queue_settings.broker,
            prefix=queue_settings.prefix,
            webhook_secret_file=secrets,
            webhook_networks=("127.0.0.0/8",),
        )

    def test_they_are_off_by_default(self, client: httpx.Client, document: dict[str, Any]) -> None:
        document["webhook"] = {"url": "https://example.org/"}
        for path in ("/v1/jobs", "/v1/validate"):
            members = problem(client.post(path, json=document), 422, "unsupported")
            assert members["errors"][0]["pointer"] == "/webhook"

    @pytest.mark.parametrize(
        "url",
        [
            "http://example.org/",
            "https://10.0.0.1/",
            "https://169.254.169.254/latest/meta-data",
            "https://[::1]/",
            "http://93.184.215.14/",
        ],
    )
    def test_what_would_never_be_sent(self, settings: Settings, document: dict[str, Any], url: str) -> None:
        document["webhook"] = {"url": url}
        with served(create_app(settings)) as client:
            members = problem(client.post("/v1/jobs", json=document), 422, "invalid-document")
        assert members["errors"][0]["pointer"] == "/webhook/url"

    def test_the_service_tells(
        self, settings: Settings, receiver: Receiver, document: dict[str, Any], store: JobStore
    ) -> None:
        document["webhook"] = {"url": receiver.url}
        with served(create_app(settings)) as client:
            job = client.post("/v1/jobs", json=document).json()
            client.post(job["links"]["cancel"])
            give_up = time.monotonic() + 10
            while not receiver.received:
                assert time.monotonic() < give_up
                time.sleep(0.02)
        assert json.loads(receiver.received[0][1])["type"] == "job.cancelled"


@pytest.mark.parametrize("text", ["", "secret", "whsec_", "whsec_c2hvcnQ=", "whsec_***"])
def test_what_is_no_secret(tmp_path: Path, text: str) -> None:
    (tmp_path / "secrets").write_text(text)
    with pytest.raises(ValueError, match="secret"):
        read_secrets(tmp_path / "secrets")
