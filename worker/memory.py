"""The memory of a worker's children: as much address space as the operator allows each of them."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

from worker.errors import WorkerStartError

ROOM = 128
"""What a child must have left for a job when everything is loaded, in MiB; a small solve takes some 50."""


def limit_memory(mib: int) -> None:
    """Limit this process to ``mib`` MiB of address space.

    Beyond it an allocation fails, which ends one job; without it the kernel ends whom it likes.
    """
    resource.setrlimit(resource.RLIMIT_AS, (mib * 2**20, resource.RLIM_INFINITY))


def address_space() -> int:
    """Return how much address space this process has taken, in MiB; known on Linux only."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() // 2**20


def require_memory(mib: int) -> None:
    """Raise WorkerStartError if a child of this process would have no room for a job within ``mib`` MiB.

    To be called when everything is loaded. Looks on Linux only.
    """
    if sys.platform != "linux":
        return
    least = address_space() + ROOM
    if mib < least:
        raise WorkerStartError(
            f"ONDELETTE_MEMORY_MIB: {mib} MiB leave no room for a job; a worker with its libraries loaded "
            f"needs at least {least} here"
        )
