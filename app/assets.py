"""Files that come with the package and are shown in a browser: compressed once, told apart by their hash."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from fastapi import Request, Response

from app.negotiation import encodings, matches_etag


@dataclass(frozen=True, slots=True)
class Assets:
    """The files ``media`` (name -> media type) of a ``folder`` of the installed package ``package``."""

    package: str
    folder: str
    media: Mapping[str, str]

    def __contains__(self, name: str) -> bool:
        return name in self.media

    def answer(self, request: Request, name: str, headers: Mapping[str, str] | None = None) -> Response:
        """Return a file, compressed if the browser takes that; 304 to one that has it already.

        Raises KeyError for a file that is not among ours.
        """
        media = self.media[name]
        plain, packed, etag = _read(self.package, self.folder, name)
        # A browser asks each time, so that a new version of the service is never shown by an old page.
        headers = {"Cache-Control": "no-cache", "ETag": etag, "Vary": "Accept-Encoding", **(headers or {})}
        if matches_etag(request, etag):
            return Response(status_code=304, headers=headers)
        if "gzip" in encodings(request):
            return Response(packed, media_type=media, headers={**headers, "Content-Encoding": "gzip"})
        return Response(plain, media_type=media, headers=headers)


@cache
def _read(package: str, folder: str, name: str) -> tuple[bytes, bytes, str]:
    """The bytes of a file, the same compressed, and its entity tag."""
    content = (files(package) / folder / name).read_bytes()
    return content, gzip.compress(content, mtime=0), f'"{hashlib.sha256(content).hexdigest()[:32]}"'
