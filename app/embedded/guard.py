"""Ends the processes of a service whose supervisor has died without stopping them.

Runs as a process of its own (``python -m app.embedded.guard``). Its standard input is a pipe that only the
supervisor holds open: each line ``+PID SECONDS`` names a process and the time that it may take to stop, and
``-PID`` one that has ended. End of file means that the supervisor is gone, by whatever death; what is still
listed is then stopped, last started first. A pipe works on every POSIX system and has no race with the
death of the parent.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable
from functools import partial


def stop_process(pid: int, seconds: float, ended: Callable[[], bool]) -> None:
    """Ask the leader of process group ``pid`` to stop, wait, then kill what is left of the group.

    ``ended()`` tells whether the leader has ended. Only the leader is asked: it knows how to stop its
    children, which may swallow signals while they are inside a native solver.
    """
    try:
        os.kill(pid, signal.SIGTERM)
    except ProcessLookupError:
        pass
    else:
        deadline = time.monotonic() + seconds
        while not ended() and time.monotonic() < deadline:
            time.sleep(0.02)
    kill_group(pid)


def kill_group(pid: int) -> None:
    """Kill what is left of the process group that ``pid`` led."""
    # Nobody may be left, or (macOS) only a leader that has ended and waits to be collected.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def _gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def watch(lines: Iterable[str]) -> None:
    """Keep the list until ``lines`` ends, then stop what is on it."""
    running: dict[int, float] = {}
    for line in lines:
        if line.startswith("+"):
            pid, seconds = line[1:].split()
            running[int(pid)] = float(seconds)
        else:
            running.pop(int(line[1:]), None)
    for leader, grace in reversed(running.items()):
        stop_process(leader, grace, partial(_gone, leader))


if __name__ == "__main__":
    watch(sys.stdin)
