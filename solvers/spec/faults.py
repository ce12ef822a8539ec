"""From a mistake deep inside a document to a `Fault` with its JSON pointer."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pydantic_core import PydanticCustomError

from solvers.errors import Fault, FaultType, pointer

Path = tuple[str | int, ...]
Flaw = tuple[Path, str, FaultType]
"""Where, what is wrong and what would be right, and the type of the mistake."""

MAX_FAULTS = 1000


def kind_of(value: object) -> str:
    """Return what a JSON value is, in words for an error message; never the value itself."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return "a number"
    if isinstance(value, str):
        return "text"
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list | tuple):
        return "a list"
    return f"a value of type {type(value).__name__}"


@dataclass(slots=True)
class Flaws:
    """Mistakes found below one place of the document; each path counts from there."""

    found: list[Flaw] = field(default_factory=list)

    def add(self, detail: str, *path: str | int, type: FaultType = "invalid") -> None:
        """Take note of a mistake at ``path``; past 1,000 nothing is noted."""
        if len(self.found) < MAX_FAULTS:
            self.found.append((path, detail, type))

    def take(self, others: Flaws, *place: str | int) -> None:
        """Take note of all mistakes that were found below ``place``."""
        for path, detail, kind in others.found:
            self.add(detail, *place, *path, type=kind)

    def faults(self) -> list[Fault]:
        """Return the mistakes, their paths counted from the root of the document."""
        return [Fault(pointer(path), detail, type) for path, detail, type in self.found]

    def raise_any(self) -> None:
        """Raise all mistakes as one pydantic error, to be taken apart again by `translate`."""
        if self.found:
            raise PydanticCustomError("flaws", "the value has flaws", {"flaws": self.found})


def refuse(detail: str, *path: str | int, type: FaultType = "invalid") -> PydanticCustomError:
    """Return the pydantic error for one mistake at ``path`` below the field that is being checked."""
    context: dict[str, Any] = {"flaws": [(path, detail, type)]}
    return PydanticCustomError("flaws", "the value has flaws", context)
