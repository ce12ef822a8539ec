"""Programs that were compiled once, for the next problem of the same structure.

A sweep over a parameter, a family of slews, a refinement in rounds: the structure of a program (expressions,
dimensions, mesh, which bounds there are) stays, its numbers change. What is kept is the builder, with all
matrices, and the optimizer with its compiled functions; the numbers are asked anew each time.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Protocol

from solvers.optimizers.outcome import Optimizer


class Builder(Protocol):
    """What keeps the matrices of a structure."""

    @property
    def size(self) -> int:
        """The number of unknowns."""
        ...


@dataclass(frozen=True)
class CompiledStructure:
    """A finished builder and an optimizer on its functions."""

    builder: Builder
    optimizer: Optimizer


class StructureCache:
    """The structures used last, together of at most ``most_unknowns`` unknowns.

    An entry is taken out while it is in use: an optimizer solves one program at a time, and a second solve of
    the same structure meanwhile compiles its own.
    """

    def __init__(self, most_unknowns: int) -> None:
        self._most = most_unknowns
        self._entries: OrderedDict[Hashable, CompiledStructure] = OrderedDict()
        self._lock = threading.Lock()

    def take(self, key: Hashable) -> CompiledStructure | None:
        """Take out the structure of this key, None where there is none."""
        with self._lock:
            return self._entries.pop(key, None)

    def put(self, key: Hashable, structure: CompiledStructure) -> None:
        """Keep a structure; those not used for longest make room, and what is too large is not kept."""
        with self._lock:
            self._entries[key] = structure
            while self.unknowns > self._most:
                self._entries.popitem(last=False)

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._entries.clear()

    @property
    def unknowns(self) -> int:
        """The number of unknowns of all structures that are kept."""
        return sum(structure.builder.size for structure in self._entries.values())

    def __len__(self) -> int:
        """The number of structures that are kept."""
        return len(self._entries)


# About a kilobyte an unknown: at most some 200 MiB a process.
STRUCTURES = StructureCache(most_unknowns=200_000)
"""The cache of this process."""
