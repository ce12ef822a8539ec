"""What an operator sees of a running service: its log, its traces, what the doctor says."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest
from click.testing import CliRunner
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest

from app.cli import main
from tests.acceptance.conftest import Document, wait_until
from tests.bad_documents import FLEXIBLE_SPACECRAFT

SECRET_NAME = "a name that is nobody's business"


@dataclass
class Collector:
    """Receives traces as OpenTelemetry's own collector does (OTLP over HTTP)."""

    spans: list[tuple[str, Any]] = field(default_factory=list)

    def take(self, body: bytes) -> None:
        """Note the spans of a request, each with the service that it is of."""
        for resource in ExportTraceServiceRequest.FromString(body).resource_spans:
            service = next(
                a.value.string_value for a in resource.resource.attributes if a.key == "service.name"
            )
            for scope in resource.scope_spans:
                self.spans += [(service, span) for span in scope.spans]


@pytest.fixture(scope="module")
def collector() -> Iterator[tuple[str, Collector]]:
    collected = Collector()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            if self.headers.get("Content-Encoding") == "gzip":
                import gzip

                body = gzip.decompress(body)
            collected.take(body)
            self.send_response(200)
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}", collected
        server.shutdown()
        thread.join()


@dataclass(frozen=True)
class Observed:
    """A running service, its folder and its log."""

    url: str
    folder: Path
    log: Path

    def lines(self) -> list[dict[str, Any]]:
        """The lines of its log that are JSON."""
        return [json.loads(line) for line in self.log.read_text().splitlines() if line.startswith("{")]


@pytest.fixture(scope="module")
def observed(
    collector: tuple[str, Collector], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Observed]:
    folder = tmp_path_factory.mktemp("observed")
    log = folder / "log"
    environment = {
        **os.environ,
        "ONDELETTE_LOG_FORMAT": "json",
        "OTEL_EXPORTER_OTLP_ENDPOINT": collector[0],
        "OTEL_BSP_SCHEDULE_DELAY": "200",
        "NO_PROXY": "127.0.0.1",
    }
    command = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--workers", "1", "--data"]
    with log.open("wb") as output:
        process = subprocess.Popen(
            [*command, str(folder / "data")], env=environment, stdout=output, stderr=output
        )
    try:
        give_up = time.monotonic() + 40
        while (found := re.search(r"^API +(\S+)", log.read_text(), re.MULTILINE)) is None:
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < give_up, log.read_text()
            time.sleep(0.05)
        yield Observed(found[1], folder / "data", log)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20)


@pytest.fixture(scope="module")
def job(observed: Observed) -> Document:
    """A job that was solved, submitted with an id of its request and inside a trace."""
    headers = {
        "X-Request-Id": "find-me",
        "Prefer": "wait=30",
        "traceparent": "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01",
        "Authorization": "Bearer ond_000000000000_not-a-key-but-a-secret",
    }
    document = {**FLEXIBLE_SPACECRAFT, "name": SECRET_NAME}
    answer = httpx.post(
        f"{observed.url}/v1/jobs?x=y", json=document, headers=headers, timeout=40, trust_env=False
    )
    solved: Document = answer.json()
    assert solved["status"] == "succeeded"
    return solved


def test_the_lines_of_a_request_and_of_its_job_are_found_by_its_id(observed: Observed, job: Document) -> None:
    def lines_of(logger: str) -> list[dict[str, Any]]:
        found = [line for line in observed.lines() if line.get("request_id") == "find-me"]
        return [line for line in found if line["logger"] == logger]

    # The worker writes its last line when the end of the job is already known to everybody, and the API its
    # own when the answer is sent.
    wait_until(
        lambda: (
            bool(lines_of("ondelette.access"))
            and any("succeeded" in line["message"] for line in lines_of("worker.tasks"))
        )
    )
    (access,) = lines_of("ondelette.access")
    assert (access["method"], access["path"], access["status"]) == ("POST", "/v1/jobs", 202)
    assert 0 < access["seconds"] < 40
    solved = lines_of("worker.tasks")[-1]
    assert solved["job_id"] == job["id"]
    assert "succeeded" in solved["message"]


def test_neither_documents_nor_keys_are_logged(observed: Observed, job: Document) -> None:
    httpx.post(f"{observed.url}/v1/jobs", json={"name": SECRET_NAME}, trust_env=False)
    httpx.get(f"{observed.url}/nothing", headers={"Authorization": "Bearer but-a-secret"}, trust_env=False)
    text = observed.log.read_text()
    assert len(observed.lines()) > 5
    for secret in (SECRET_NAME, "but-a-secret", "stiffness"):
        assert secret not in text


def test_a_trace_goes_through_the_queue(collector: tuple[str, Collector], job: Document) -> None:
    def ours() -> list[tuple[str, Any]]:
        return [
            (service, span) for service, span in collector[1].spans if span.trace_id.hex().startswith("0af7")
        ]

    # Each process sends its spans when it likes; the request's ends after the solve that it waited for.
    ends = {("ondelette-api", "POST /v1/jobs"), ("ondelette-worker", "solve")}
    wait_until(lambda: ends <= {(service, span.name) for service, span in ours()})
    by_id = {span.span_id: (service, span) for service, span in ours()}
    (solve,) = (span for service, span in ours() if service == "ondelette-worker")
    assert solve.name == "solve"
    assert {a.key: a.value.string_value for a in solve.attributes}["ondelette.job_id"] == job["id"]
    # From the solve up to the request, and from there to whoever sent it.
    service, span = by_id[solve.parent_span_id]
    while span.parent_span_id in by_id:
        service, span = by_id[span.parent_span_id]
    assert (service, span.name) == ("ondelette-api", "POST /v1/jobs")
    assert span.parent_span_id.hex() == "b7ad6b7169203331"


def test_the_doctor_finds_nothing(observed: Observed) -> None:
    run = CliRunner().invoke(main, ["doctor", "--json", "--data", str(observed.folder)])
    findings = {finding["what"]: finding for finding in json.loads(run.stdout)}
    assert run.exit_code == 0, findings
    assert findings["workers"]["detail"] == "1 alive, 1 jobs at a time"
    assert "everysec" in findings["persistence"]["detail"]
    assert findings["eviction"]["verdict"] == "ok"
    assert "disk" in findings


def test_the_doctor_finds_what_is_wrong(broker: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ONDELETTE_PREFIX", "a service without workers:")
    run = CliRunner().invoke(main, ["doctor", "--json", "--broker", broker])
    verdicts = {finding["what"]: finding["verdict"] for finding in json.loads(run.stdout)}
    assert run.exit_code == 1
    assert (verdicts["persistence"], verdicts["workers"]) == ("error", "error")
    run = CliRunner().invoke(main, ["doctor", "--broker", "unix:///nowhere/at/all.sock"])
    assert run.exit_code == 1
    assert "does not answer" in run.stdout
