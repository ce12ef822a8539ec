"""A broker of one's own: how the server is run, where it keeps its data, and when it answers."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal
from urllib.parse import quote

from app.embedded.binary import ServerBinary
from app.embedded.errors import ServiceStartError

# sun_path holds 104 bytes on macOS and 108 on Linux, the closing NUL included.
LONGEST_SOCKET_PATH = 103

Fsync = Literal["everysec", "always"]


class DataDirectory:
    """The folder of one embedded service, held by a lock as long as any process of it lives.

    The lock is an open file: whoever inherits its descriptor keeps it, and the kernel frees it with the
    last of them, so that no stale lock can remain.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.expanduser().resolve()
        try:
            self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._lock = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise ServiceStartError(
                f"The data folder {self.path} cannot be used: {error.strerror}."
            ) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            owner = os.read(self._lock, 32).decode() or "unknown"
            os.close(self._lock)
            raise ServiceStartError(
                f"Another ondelette service (process {owner}) is using the data folder {self.path}. "
                "Stop it, or choose another folder with --data."
            ) from error
        os.ftruncate(self._lock, 0)
        os.write(self._lock, str(os.getpid()).encode())

    @property
    def lock(self) -> int:
        """Descriptor of the lock, to be inherited by processes that must not outlive it."""
        return self._lock

    def close(self) -> None:
        """Release the lock."""
        os.close(self._lock)


def address_of(data: Path) -> str | None:
    """The address of the broker that is, or was last, embedded in a data folder; None if none ever was."""
    note = data.expanduser() / "broker" / "address"
    return note.read_text().strip() if note.exists() else None


class EmbeddedBroker:
    """A server with an append-only file in the data folder, reached through a private unix socket only.

    The files of one server are not read by an older one or by the other flavour, so the folder remembers
    who wrote it; ``ServiceStartError`` is raised rather than starting empty or not at all. ``fsync``: when
    what is written is forced to the disk (docs/durability.md).
    """

    def __init__(self, binary: ServerBinary, data: DataDirectory, fsync: Fsync = "everysec") -> None:
        self.binary = binary
        self._fsync = fsync
        self.folder = data.path / "broker"
        self.folder.mkdir(exist_ok=True)
        self.folder.chmod(0o700)
        self._check_writer()
        self._temporary: Path | None = None
        self.socket = self.folder / "broker.sock"
        if len(os.fsencode(self.socket)) > LONGEST_SOCKET_PATH or quote(str(self.socket)) != str(self.socket):
            # Too deep for the kernel, or not to be written in a URL as it is. Only its owner may enter
            # the folder that mkdtemp makes.
            self._temporary = Path(tempfile.mkdtemp(prefix="ondelette-", dir="/tmp"))
            self.socket = self._temporary / "broker.sock"
        (self.folder / "address").write_text(f"{self.url}\n")

    def _check_writer(self) -> None:
        """Refuse files that this server cannot be trusted to read, and sign the folder."""
        signature = self.folder / "written-by"
        writer = signature.read_text().strip() if signature.exists() else ""
        if writer:
            flavour, _, version = writer.partition(" ")
            written = tuple(int(part) for part in version.split("."))
            if flavour != self.binary.flavour or written[:2] > self.binary.version[:2]:
                raise ServiceStartError(
                    f"The data in {self.folder} was written by {writer}, and {self.binary} cannot be trusted "
                    "to read it. Name the former server with --broker-binary, or another folder with --data."
                )
        signature.write_text(f"{self.binary}\n")

    @property
    def url(self) -> str:
        """Address for ``--broker`` and ``ONDELETTE_BROKER``."""
        return f"unix://{self.socket}"

    @property
    def log(self) -> Path:
        """Where the server writes its log."""
        return self.folder / "broker.log"

    @property
    def command(self) -> list[str]:
        """The server's command line: no TCP, every change on disk, no eviction (a full broker says so)."""
        options = {
            "port": "0",
            "unixsocket": str(self.socket),
            "unixsocketperm": "700",
            "dir": str(self.folder),
            "logfile": str(self.log),
            "appendonly": "yes",
            "appendfsync": self._fsync,
            "save": "",
            "maxmemory-policy": "noeviction",
            "daemonize": "no",
        }
        return [
            str(self.binary.path),
            *(text for key, value in options.items() for text in (f"--{key}", value)),
        ]

    def wait_until_ready(self, ended: Callable[[], bool], seconds: float = 20.0) -> None:
        """Wait for an answer to PING; loading a long append-only file takes its time.

        Raises ``ServiceStartError`` with the end of the server's log when the process has ``ended()`` or the
        time is over.
        """
        import redis
        from redis.backoff import NoBackoff
        from redis.retry import Retry

        deadline = time.monotonic() + seconds
        with redis.Redis(unix_socket_path=str(self.socket), retry=Retry(NoBackoff(), 0)) as client:
            while True:
                try:
                    client.ping()
                except redis.RedisError as error:
                    if ended() or time.monotonic() > deadline:
                        raise ServiceStartError(
                            f"{self.binary} does not answer ({error}); the end of {self.log}:\n"
                            f"{self._log_tail()}"
                        ) from error
                    time.sleep(0.02)
                else:
                    return

    def _log_tail(self) -> str:
        return "\n".join(self.log.read_text().splitlines()[-8:]) if self.log.exists() else "(no log)"

    def remove_socket(self) -> None:
        """Remove the folder of the socket if one was made outside the data folder."""
        if self._temporary is not None:
            shutil.rmtree(self._temporary, ignore_errors=True)
