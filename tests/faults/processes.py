"""Processes that are killed, stopped and started again, like those of a service under a supervisor."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path


class Process:
    """A Python process that is started again after every death that it is made to die."""

    def __init__(
        self, code: str, arguments: list[str], environment: Mapping[str, str], log: Path, descriptor: int = -1
    ) -> None:
        self._command = [sys.executable, "-c", code, *arguments]
        self._environment = environment
        self._log = log
        self._descriptors = () if descriptor < 0 else (descriptor,)
        self.start()

    def start(self) -> None:
        """Start it."""
        with self._log.open("ab") as output:
            self._process = subprocess.Popen(
                self._command,
                env=dict(self._environment),
                stdout=output,
                stderr=output,
                pass_fds=self._descriptors,
            )

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def children(self) -> list[int]:
        """The numbers of its children."""
        try:
            return [
                int(child) for child in Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text().split()
            ]
        except FileNotFoundError:
            return []

    def signal(self, number: signal.Signals, *, all_of_it: bool = False) -> None:
        """Send a signal to it, or to its children as well."""
        for pid in [self.pid, *(self.children() if all_of_it else [])]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)

    def kill(self) -> None:
        """Kill it without a chance to say anything, and start it again."""
        self._process.kill()
        self._process.wait()
        self.start()

    def end(self) -> int:
        """End it in order; return its exit code."""
        self.signal(signal.SIGTERM)
        self.signal(signal.SIGCONT, all_of_it=True)
        try:
            return self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()

    def cpu(self) -> float:
        """CPU time of the process and its children, in seconds."""
        return sum(cpu_seconds(pid) for pid in (self.pid, *self.children()))

    def memory(self) -> int:
        """Resident memory of the process, in bytes."""
        return memory_bytes(self.pid)

    def files(self) -> int:
        """The number of its open files."""
        return len(os.listdir(f"/proc/{self.pid}/fd"))


def memory_bytes(pid: int) -> int:
    """Resident memory of a process, in bytes."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def cpu_seconds(pid: int) -> float:
    """CPU time of a process, and of those of its children that have ended, so far, in seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


API = """
import socket, sys, uvicorn
from app.main import create_app
config = uvicorn.Config(create_app(), access_log=False, timeout_graceful_shutdown=2)
uvicorn.Server(config).run(sockets=[socket.socket(fileno=int(sys.argv[1]))])
"""

# The real worker; each solve that is begun, and each that comes to its end, is noted in a file.
WORKER = """
import os, sys, time
import worker.tasks
from worker.main import run

notes = os.open(sys.argv[2], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
solve = worker.tasks.solve

def noted(spec, progress, *arguments, **more):
    os.write(notes, f"start {spec.name} {time.time()}\\n".encode())
    solution = solve(spec, progress, *arguments, **more)
    os.write(notes, f"end {spec.name} {time.time()}\\n".encode())
    return solution

worker.tasks.solve = noted
sys.exit(run(concurrency=1, name=sys.argv[1]))
"""


def listener() -> socket.socket:
    """A listening socket that outlives the processes that serve it."""
    return socket.create_server(("127.0.0.1", 0), backlog=256)
