"""One root for every error that ondelette raises on purpose, and the errors of documents and solves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

FaultType = Literal["invalid", "unsupported", "limit"]

_LONGEST_KEY = 300


class OndeletteError(Exception):
    """Root of the errors that ondelette raises on purpose."""


def pointer(path: Iterable[str | int]) -> str:
    """Return the JSON pointer (RFC 6901) of a place in a document; what UTF-8 cannot hold is escaped.

    A key of more than 300 characters, which no document needs, is cut.
    """
    parts = (str(part)[:_LONGEST_KEY].replace("~", "~0").replace("/", "~1") for part in path)
    return "".join(f"/{part}" for part in parts).encode("utf-8", "backslashreplace").decode()


@dataclass(frozen=True, slots=True)
class Fault:
    """One mistake of a job document.

    ``pointer`` is the JSON pointer (RFC 6901) into the document as submitted, ``""`` for the whole of it;
    ``detail`` says what is wrong and what would be right; ``type`` tells a mistake (``invalid``) from what
    this version does not do yet (``unsupported``) and from a size limit (``limit``).
    """

    pointer: str
    detail: str
    type: FaultType = "invalid"


class DocumentError(OndeletteError):
    """A job document that cannot be solved as it stands; carries every fault that was found."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(f"{fault.pointer}: {fault.detail}" for fault in self.faults))


class ExpressionError(OndeletteError):
    """A text that is not an expression; ``position`` counts characters from 0."""

    def __init__(self, detail: str, position: int) -> None:
        self.detail = detail
        self.position = position
        super().__init__(f"{detail} (at character {position + 1})")
