"""A job as one file: everything to repeat it elsewhere, and to check its answer without a service.

A ZIP archive of plain texts: ``document.json`` (as submitted, byte by byte), ``job.json`` (the record),
``options.json`` (the document with all defaults), ``versions.json`` (of the software that solved it),
``result.json`` and ``log.txt``; the result and what is read from it are missing where there is none. With
flights comes ``flown.json``, the result of the job whose answer they flew, where that is still kept.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from solvers.errors import OndeletteError

MAX_BYTES = 512 * 2**20
"""Most bytes that a part of a bundle may have when it is unpacked."""

_README = """A job of ondelette. To verify its answer again, without a service:

    ondelette replay THIS_FILE.zip

"""
_CONTENTS = {
    "document.json": "the job document as submitted",
    "options.json": "the same with every default written out",
    "job.json": "how the job went",
    "versions.json": "the software that solved it",
    "result.json": "the answer",
    "flown.json": "the answer that was flown",
    "log.txt": "what happened to the job, line by line",
}
_NO_ANSWER = "A job of ondelette that ended without an answer; there is nothing to verify.\n\n"


class BundleError(OndeletteError):
    """A file that is not a bundle, or one that lacks or garbles a part."""


@dataclass(frozen=True, slots=True)
class Bundle:
    """What is read back: the document's text, the result if there is one, and the result that was flown."""

    document: bytes
    result: Mapping[str, Any] | None
    flown: Mapping[str, Any] | None = None

    @property
    def of_flights(self) -> bool:
        """Whether the job flew the answer of another one."""
        return self.flown is not None or (self.result or {}).get("kind") == "flights"


def pack(
    document: bytes,
    job: Mapping[str, Any],
    result: Mapping[str, Any] | None,
    log: Sequence[str],
    flown: Mapping[str, Any] | None = None,
) -> bytes:
    """Return the archive of a job; ``log`` are lines without their ends, ``flown`` is the result it flew."""
    parts: dict[str, bytes] = {
        "document.json": document,
        "job.json": _pretty(job),
        "log.txt": "".join(f"{line}\n" for line in log).encode(),
    }
    if result is not None:
        parts |= {
            "options.json": _pretty(result["resolved"]),
            "versions.json": _pretty(result["provenance"]),
            "result.json": _compact(result),
        }
    if flown is not None:
        parts["flown.json"] = _compact(flown)
    listed = "".join(f"{name:<13}  {words}\n" for name, words in _CONTENTS.items() if name in parts)
    about = _README if result is not None else _NO_ANSWER
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("README.txt", about + listed)
        for name, text in parts.items():
            archive.writestr(name, text)
    return buffer.getvalue()


def unpack(raw: bytes) -> Bundle:
    """Read an archive of `pack`; raises BundleError."""
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            document = _part(archive, "document.json")
            if document is None:
                raise BundleError("the bundle has no document.json")
            texts = [_part(archive, name) for name in ("result.json", "flown.json")]
            result, flown = (None if text is None else json.loads(text) for text in texts)
    except (zipfile.BadZipFile, EOFError, ValueError, NotImplementedError, RecursionError) as error:
        raise BundleError(f"this is no bundle of a job: {error}") from error
    for name, value in (("result.json", result), ("flown.json", flown)):
        if value is not None and not isinstance(value, dict):
            raise BundleError(f"{name} is not an object")
    return Bundle(document, result, flown)


def _part(archive: zipfile.ZipFile, name: str) -> bytes | None:
    try:
        info = archive.getinfo(name)
    except KeyError:
        return None
    with archive.open(info) as file:
        # The size that the archive announces may be a lie.
        text = file.read(MAX_BYTES + 1)
    if len(text) > MAX_BYTES:
        raise BundleError(f"{name} has more than {MAX_BYTES:,} bytes")
    return text


def _compact(value: Any) -> bytes:
    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()


def _pretty(value: Any) -> bytes:
    return (json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()
