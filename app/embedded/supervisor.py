"""Starts processes, restarts those that die, and stops them in the reverse order of their start."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import IO

from app.embedded.guard import kill_group, stop_process

FIRST_PAUSE = 0.5
LONGEST_PAUSE = 30.0
# A process that has lived as long as this was healthy: its next death starts from the first pause again.
HEALTHY = 60.0


@dataclass(frozen=True, slots=True)
class ChildSpec:
    """A process to keep running: ``grace`` is the time in seconds that it may take to stop when asked."""

    name: str
    command: Sequence[str]
    grace: float
    environment: Mapping[str, str] = field(default_factory=dict)
    descriptors: tuple[int, ...] = ()


@dataclass(slots=True)
class _Child:
    """A process with its history; ``restart_at`` is set while it waits to be started again."""

    spec: ChildSpec
    process: subprocess.Popen[bytes]
    started_at: float
    pause: float = FIRST_PAUSE
    restart_at: float | None = None


class Supervisor:
    """Keeps processes running until it is told to stop.

    Each process leads a session of its own, so that Ctrl-C in the terminal reaches the supervisor alone,
    which stops them in order. A guard process ends them should the supervisor be killed; it inherits
    ``held`` (the lock of the data folder), which is thereby released only when everything has ended.
    """

    def __init__(
        self, say: Callable[[str], None], output: IO[bytes] | None = None, held: tuple[int, ...] = ()
    ) -> None:
        self._say = say
        self._output = output
        self._held = held
        self._children: list[_Child] = []
        self._guard = self._start_guard()

    def start(self, spec: ChildSpec) -> None:
        """Start a process; from now on ``poll`` restarts it."""
        self._children.append(_Child(spec, self._spawn(spec), time.monotonic()))

    def _spawn(self, spec: ChildSpec) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(  # noqa: S603 - the commands are our own
            spec.command,
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=self._output,
            env={**os.environ, **spec.environment},
            pass_fds=spec.descriptors,
            start_new_session=True,
        )
        self._tell_guard(f"+{process.pid} {spec.grace}\n")
        return process

    def _start_guard(self) -> subprocess.Popen[bytes]:
        guard = subprocess.Popen(
            [sys.executable, "-m", "app.embedded.guard"],
            stdin=subprocess.PIPE,
            bufsize=0,
            pass_fds=self._held,
            start_new_session=True,
        )
        for child in self._running():
            _write(guard, f"+{child.process.pid} {child.spec.grace}\n")
        return guard

    def _tell_guard(self, line: str) -> None:
        try:
            _write(self._guard, line)
        except BrokenPipeError:
            # Somebody ended the guard: a new one is told everything that runs.
            self._end_guard()
            self._guard = self._start_guard()

    def _running(self) -> list[_Child]:
        return [child for child in self._children if child.restart_at is None]

    def ended(self) -> dict[str, int]:
        """Exit codes, by name, of processes that have ended since ``poll`` last looked."""
        codes = {child.spec.name: child.process.poll() for child in self._running()}
        return {name: code for name, code in codes.items() if code is not None}

    def poll(self) -> None:
        """Look after the processes once: note deaths, start again whose pause is over."""
        now = time.monotonic()
        ended = self.ended()
        for child in self._children:
            if child.spec.name in ended:
                kill_group(child.process.pid)
                self._tell_guard(f"-{child.process.pid}\n")
                if now - child.started_at > HEALTHY:
                    child.pause = FIRST_PAUSE
                code = ended[child.spec.name]
                self._say(f"{child.spec.name} ended with code {code}; starting it again in {child.pause:g} s")
                child.restart_at = now + child.pause
                child.pause = min(2 * child.pause, LONGEST_PAUSE)
            elif child.restart_at is not None and now >= child.restart_at:
                child.process, child.started_at, child.restart_at = self._spawn(child.spec), now, None

    def stop(self) -> None:
        """Stop everything, last started first, then the guard."""
        for child in reversed(self._running()):
            process = child.process
            stop_process(process.pid, child.spec.grace, partial(_has_ended, process))
            process.wait()
            self._tell_guard(f"-{process.pid}\n")
        self._children.clear()
        self._end_guard()

    def _end_guard(self) -> None:
        assert self._guard.stdin is not None
        self._guard.stdin.close()
        self._guard.wait()


def _has_ended(process: subprocess.Popen[bytes]) -> bool:
    return process.poll() is not None


def _write(guard: subprocess.Popen[bytes], line: str) -> None:
    assert guard.stdin is not None
    guard.stdin.write(line.encode())
