"""``ondelette serve``, ``api``, ``worker`` as processes: they start, answer, survive deaths and stop."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPResponse
from pathlib import Path

import httpx
import pytest
from click.testing import CliRunner

from app.cli import main
from app.cli.service import is_loopback
from app.client import Client, ServerUnreachable
from app.embedded.broker import DataDirectory
from app.embedded.errors import ServiceStartError
from tests.bad_documents import FLEXIBLE_SPACECRAFT, changed
from worker.settings import QueueSettings


@contextmanager
def serving(*arguments: str | Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``ondelette serve`` on a free port: its process and its address. Stopped by Ctrl-C."""
    command = [
        sys.executable,
        "-m",
        "app.cli",
        "serve",
        "--port",
        "0",
        "--workers",
        "1",
        *map(str, arguments),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        said = ""
        while (address := re.search(r"^API +(\S+)", said, re.MULTILINE)) is None:
            line = process.stdout.readline()
            assert line, f"it ended: {said}"
            said += line
        try:
            yield process, address.group(1)
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            process.wait(20)


def processes_of(data: Path) -> dict[int, str]:
    """Command lines, by process id, of all processes that were started for the service in ``data``.

    The broker names the folder; the others are told the broker's address by their environment.
    """
    found = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit() and int(folder.name) != os.getpid():
            try:
                words = (folder / "cmdline").read_bytes()
                if words and str(data).encode() in words + (folder / "environ").read_bytes():
                    found[int(folder.name)] = words.replace(b"\0", b" ").decode()
            except (FileNotFoundError, ProcessLookupError, PermissionError):
                continue
    return found


def wait_until_gone(data: Path, seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while left := processes_of(data):
        assert time.monotonic() < deadline, left
        time.sleep(0.05)


def pid_of(data: Path, words: str) -> int:
    """The oldest process whose command line contains ``words`` (the parent of those that are forked)."""
    return min(pid for pid, command in processes_of(data).items() if words in command)


def test_a_service_solves_for_itself_alone_and_stops_at_ctrl_c(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with serving("--data", data) as (process, url), Client(url) as client:
        assert client.solve(FLEXIBLE_SPACECRAFT, timeout=30)["success"] is True
        # What is no HTTP is refused like everything else.
        with socket.create_connection((httpx.URL(url).host, httpx.URL(url).port or 0)) as raw:
            raw.sendall(b"no HTTP at all\r\n\r\n")
            refusal = HTTPResponse(raw)
            refusal.begin()
            members = json.loads(refusal.read())
        assert (refusal.status, members["type"]) == (400, "/problems/bad-request")
        assert refusal.headers["content-type"] == "application/problem+json"
        assert members["request_id"] == refusal.headers["x-request-id"]
        second = CliRunner().invoke(main, ["serve", "--port", "0", "--data", str(data)])
        assert second.exit_code == 3, "the folder is taken"
        assert f"(process {process.pid}) is using the data folder {data}" in second.stderr
        started = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
        assert time.monotonic() - started < 5, "nothing was running: no reason to wait"
    assert processes_of(data) == {}


def test_a_running_job_is_handed_back_and_solved_by_the_next_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ONDELETTE_SHUTDOWN_SECONDS", "1")
    data = tmp_path / "data"
    long = changed("/method/J", 12)
    with serving("--data", data) as (process, url), Client(url) as client:
        done = client.job(client.solve(FLEXIBLE_SPACECRAFT, timeout=30)["job_id"])
        job = client.submit(long)
        while client.job(job["id"])["status"] != "running":
            time.sleep(0.05)
        started = time.monotonic()
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
        assert time.monotonic() - started < 8
    assert processes_of(data) == {}
    with serving("--data", data) as (_, url), Client(url) as client:
        while (again := client.job(job["id"]))["status"] == "queued":
            time.sleep(0.05)
        assert again["attempts"] == 2
        # What had ended is remembered as it was.
        assert client.job(done["id"]) == done
        assert len(list(client.jobs())) == 2


def test_a_start_that_is_interrupted_leaves_nothing(tmp_path: Path) -> None:
    data = tmp_path / "data"
    command = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data", str(data)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        # Said at the moment at which the first process is started.
        assert process.stdout.readline().startswith("broker ")
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 0
    assert processes_of(data) == {}


def test_processes_that_are_killed_are_started_again_and_none_outlives_the_service(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with serving("--data", data) as (process, url), Client(url) as client:
        job = client.solve(FLEXIBLE_SPACECRAFT, timeout=30)["job_id"]
        for words in ("app.cli worker", "valkey-server", "app.cli api"):
            os.kill(pid_of(data, words), signal.SIGKILL)
        # The listening socket outlives the API: who asks in between waits instead of being refused.
        assert client.wait(job, timeout=30)["status"] == "succeeded"
        assert client.solve(FLEXIBLE_SPACECRAFT, timeout=40)["success"] is True
        assert len(processes_of(data)) >= 4
        process.kill()
        process.wait()
        wait_until_gone(data, 15)
        with pytest.raises(ServerUnreachable):
            client.cases()
    # The last of them to go releases the folder.
    deadline = time.monotonic() + 15
    while True:
        try:
            DataDirectory(data).close()
        except ServiceStartError:
            assert time.monotonic() < deadline
            time.sleep(0.1)
        else:
            break


def test_broker_and_address_can_be_somebody_elses(
    tmp_path: Path, broker: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The server is that of other tests too, which may have left a key.
    monkeypatch.setenv("ONDELETTE_PREFIX", "somebody else's:")
    arguments = ("--broker", broker, "--host", "0.0.0.0", "--insecure", "--data", tmp_path / "unused")
    with serving(*arguments) as (_, url), Client(url) as client:
        assert client.solve(FLEXIBLE_SPACECRAFT, timeout=30)["success"] is True
        listening = [line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
        assert f"00000000:{httpx.URL(url).port:04X}" in listening, "on every address"
    assert not (tmp_path / "unused").exists()


@pytest.mark.parametrize("command", ["serve", "api"])
@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", ""])
def test_nobody_listens_to_the_network_without_keys(
    command: str, host: str, queue_settings: QueueSettings, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ONDELETTE_PREFIX", queue_settings.prefix)
    arguments = [command, "--host", host, "--broker", queue_settings.broker]
    answer = CliRunner().invoke(main, arguments)
    assert answer.exit_code == 2
    assert "there is no API key" in answer.stderr
    assert "--insecure" in answer.stderr
    monkeypatch.setenv("ONDELETTE_BOOTSTRAP_KEY_FILE", str(tmp_path / "missing"))
    answer = CliRunner().invoke(main, arguments)
    assert answer.exit_code == 2
    assert "ONDELETTE_BOOTSTRAP_KEY_FILE" in answer.stderr


def test_a_data_folder_without_a_past_has_no_keys(tmp_path: Path) -> None:
    answer = CliRunner().invoke(main, ["serve", "--host", "0.0.0.0", "--data", str(tmp_path / "new")])
    assert answer.exit_code == 2
    assert "refusing to start: " in answer.stderr
    assert "there is no API key" in answer.stderr
    assert not (tmp_path / "new").exists()


def test_with_a_key_it_listens_and_lets_in_who_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = ("--data", str(tmp_path))
    run = CliRunner()
    with serving(*data) as (_, url):
        made = run.invoke(main, ["keys", "create", "Ada", "--project", "slews", *data])
        assert made.exit_code == 0, made.output
        key = made.stdout.strip()
        with Client(url, key=key) as client:
            assert client.submit(FLEXIBLE_SPACECRAFT)["project"] == "slews"
    monkeypatch.setenv("ONDELETTE_KEY_CACHE_SECONDS", "0.1")
    with serving("--host", "0.0.0.0", *data) as (_, url):
        with Client(url, key=key) as client:
            assert len(list(client.jobs())) == 1
        refused = run.invoke(main, ["list", "--server", url])
        assert (refused.exit_code, refused.stderr.endswith("ONDELETTE_KEY.\n")) == (1, True), refused.output
        assert httpx.get(f"{url}/readyz", trust_env=False).status_code == 200
        listed = json.loads(run.invoke(main, ["keys", "list", "--json", *data]).stdout)
        assert [(entry["name"], entry["valid"]) for entry in listed] == [("Ada", True)]
        assert key.rpartition("_")[2] not in run.invoke(main, ["keys", "list", *data]).output
        assert run.invoke(main, ["keys", "revoke", listed[0]["id"], *data]).exit_code == 0
        assert run.invoke(main, ["keys", "revoke", "nobody", *data]).exit_code == 2
        time.sleep(0.2)
        assert httpx.get(f"{url}/v1/jobs", headers={"Authorization": f"Bearer {key}"}).status_code == 401
    # All keys are revoked: there is none to enter with.
    answer = run.invoke(main, ["serve", "--host", "0.0.0.0", *data, "--port", "0"])
    assert answer.exit_code == 3
    assert "there is no API key" in answer.stderr


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_loopback_addresses_are_known(host: str) -> None:
    assert is_loopback(host)


def test_a_port_in_use_is_told_before_anything_starts(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        arguments = ["--port", str(port), "--data", str(tmp_path / "data")]
        answer = CliRunner().invoke(main, ["serve", *arguments])
    assert answer.exit_code == 3
    assert f"Cannot listen on 127.0.0.1 port {port}: Address already in use" in answer.stderr
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("command", ["serve", "api", "worker"])
def test_an_address_that_is_none_is_refused(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = CliRunner().invoke(main, [command, "--broker", "http://localhost"])
    assert answer.exit_code == 2
    assert answer.stderr.startswith("ondelette: --broker: the broker's address must look like")
    monkeypatch.setenv("ONDELETTE_BROKER", "nonsense")
    answer = CliRunner().invoke(main, [command])
    assert answer.exit_code == 2
    assert answer.stderr.startswith("ondelette: ONDELETTE_BROKER: ")


@pytest.mark.parametrize("command", ["serve", "api"])
@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("ONDELETTE_BOOTSTRAP_KEY_FILE", "short", "must hold one word of at least 32"),
        ("ONDELETTE_WEBHOOK_SECRET_FILE", "short", "a secret is whsec_"),
        ("ONDELETTE_WEBHOOK_SECRET_FILE", None, "No such file or directory"),
    ],
)
def test_a_file_that_cannot_be_used_is_told_before_anything_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, name: str, text: str | None, words: str
) -> None:
    monkeypatch.setenv(name, str(tmp_path / "file"))
    if text is not None:
        (tmp_path / "file").write_text(text)
    answer = CliRunner().invoke(main, [command, "--port", "0"])
    assert answer.exit_code == 2
    assert answer.stdout == ""
    (line,) = answer.stderr.splitlines()
    assert line.startswith(f"ondelette: {name}: ")
    assert words in line


def test_a_worker_that_could_not_store_an_answer_does_not_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ONDELETTE_RESULTS", f"file://{tmp_path}/not-mounted")
    command = [sys.executable, "-m", "app.cli", "worker", "--broker", "unix:///nowhere/at/all.sock"]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    assert answer.returncode == 3
    assert f"ondelette: results at file://{tmp_path}/not-mounted cannot be reached" in answer.stderr


def test_a_password_is_not_shown(tmp_path: Path) -> None:
    from app.embedded.service import _without_password

    assert _without_password("redis://user:secret@host:6379/0") == "redis://user:***@host:6379/0"
    assert _without_password("redis://host:6379/0") == "redis://host:6379/0"


def test_a_start_that_fails_is_told_in_one_line(tmp_path: Path) -> None:
    data = tmp_path / "data"
    (data / "broker").mkdir(parents=True)
    (data / "broker" / "written-by").write_text("redis 8.2.2\n")
    answer = CliRunner().invoke(main, ["serve", "--port", "0", "--data", str(data)])
    assert answer.exit_code == 3
    assert len(answer.stderr.splitlines()) == 1
