"""The supervisor and its guard with real processes: restarts, order of stopping, no orphans."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from app.embedded.supervisor import ChildSpec, Supervisor

# Writes its pid, and its name into a list when it is asked to stop.
OBEDIENT = """
import os, signal, sys, time, pathlib
name, folder = sys.argv[1], pathlib.Path(sys.argv[2])
def stop(*_):
    with (folder / "stopped").open("a") as file:
        file.write(name + " ")
    raise SystemExit
signal.signal(signal.SIGTERM, stop)
(folder / name).write_text(str(os.getpid()))
time.sleep(60)
"""
# Ignores the wish to stop, and so does its child.
STUBBORN = """
import os, signal, subprocess, sys, time, pathlib
signal.signal(signal.SIGTERM, signal.SIG_IGN)
name, folder = sys.argv[1], pathlib.Path(sys.argv[2])
child = subprocess.Popen([sys.executable, "-c", "import signal, time; time.sleep(60)"])
(folder / name).write_text(str(os.getpid()))
(folder / "child").write_text(str(child.pid))
time.sleep(60)
"""


def eventually(condition: Callable[[], bool], seconds: float = 10.0) -> None:
    """Wait for a condition."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not come true in time"
        time.sleep(0.02)


def alive(pid: int) -> bool:
    """Tell whether a process runs (one that has ended and was not collected does not)."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def spec(name: str, folder: Path, code: str = OBEDIENT, grace: float = 5.0) -> ChildSpec:
    return ChildSpec(name, [sys.executable, "-c", code, name, str(folder)], grace)


def pid_in(path: Path) -> int:
    eventually(lambda: path.exists() and bool(path.read_text()))
    return int(path.read_text())


@pytest.fixture
def said() -> list[str]:
    return []


def test_processes_are_stopped_last_first(tmp_path: Path, said: list[str]) -> None:
    supervisor = Supervisor(said.append)
    for name in ("broker", "worker", "API"):
        supervisor.start(spec(name, tmp_path))
    pids = [pid_in(tmp_path / name) for name in ("broker", "worker", "API")]
    supervisor.stop()
    assert (tmp_path / "stopped").read_text() == "API worker broker "
    assert not any(map(alive, pids))
    assert said == []


def test_a_process_that_dies_is_started_again_after_a_pause(tmp_path: Path, said: list[str]) -> None:
    supervisor = Supervisor(said.append)
    try:
        supervisor.start(spec("worker", tmp_path))
        first = pid_in(tmp_path / "worker")
        (tmp_path / "worker").unlink()
        os.kill(first, signal.SIGKILL)
        eventually(lambda: supervisor.ended() == {"worker": -signal.SIGKILL})
        supervisor.poll()
        assert said == ["worker ended with code -9; starting it again in 0.5 s"]
        supervisor.poll()
        assert not (tmp_path / "worker").exists(), "the pause is kept"
        time.sleep(0.5)
        supervisor.poll()
        assert pid_in(tmp_path / "worker") != first
        os.kill(pid_in(tmp_path / "worker"), signal.SIGKILL)
        eventually(lambda: bool(supervisor.ended()))
        supervisor.poll()
        assert said[-1].endswith("starting it again in 1 s"), "the pause grows"
    finally:
        supervisor.stop()


def test_a_stubborn_process_is_killed_with_its_children(tmp_path: Path, said: list[str]) -> None:
    supervisor = Supervisor(said.append)
    supervisor.start(spec("worker", tmp_path, STUBBORN, grace=0.3))
    leader, child = pid_in(tmp_path / "worker"), pid_in(tmp_path / "child")
    started = time.monotonic()
    supervisor.stop()
    assert 0.3 <= time.monotonic() - started < 3
    eventually(lambda: not alive(leader) and not alive(child))


def test_nothing_outlives_a_supervisor_that_is_killed(tmp_path: Path) -> None:
    code = (
        "import sys, time, pathlib\n"
        f"sys.path.insert(0, {str(Path(__file__).parents[2])!r})\n"
        "from app.embedded.supervisor import ChildSpec, Supervisor\n"
        "supervisor = Supervisor(print)\n"
        f"folder, codes = {str(tmp_path)!r}, {[OBEDIENT, STUBBORN]!r}\n"
        "for name, code in zip(['broker', 'worker'], codes):\n"
        "    supervisor.start(ChildSpec(name, [sys.executable, '-c', code, name, folder], 0.5))\n"
        "while True:\n"
        "    supervisor.poll()\n"
        "    time.sleep(0.05)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as process:
        pids = [pid_in(tmp_path / name) for name in ("broker", "worker", "child")]
        process.kill()
    eventually(lambda: not any(map(alive, pids)))
    assert (tmp_path / "stopped").read_text() == "broker ", "who obeys is asked first"


def test_a_guard_that_is_killed_is_replaced_and_told_everything(tmp_path: Path, said: list[str]) -> None:
    supervisor = Supervisor(said.append)
    try:
        supervisor.start(spec("broker", tmp_path, grace=0.3))
        broker = pid_in(tmp_path / "broker")
        supervisor._guard.kill()
        supervisor._guard.wait()
        supervisor.start(spec("worker", tmp_path, grace=0.3))
        pid_in(tmp_path / "worker")
        guard = supervisor._guard
        assert guard.poll() is None
        assert guard.stdin is not None
        # As if the supervisor were gone: the new guard knows also of what the old one was told.
        guard.stdin.close()
        guard.wait(10)
        assert not alive(broker)
        supervisor._guard = supervisor._start_guard()
    finally:
        supervisor.stop()
