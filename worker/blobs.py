"""A folder or an object store, as far as results need it: named bytes, written once, read and deleted.

The place is an address that fsspec understands (``file:///folder``, ``s3://bucket/prefix``, ...).
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

import fsspec
from fsspec.core import split_protocol, url_to_fs
from fsspec.implementations.local import LocalFileSystem

from worker.errors import ResultLost, ResultsUnavailable


def check_address(address: str) -> str:
    """Return the address of a place if there is something to reach it with; raises ValueError otherwise."""
    scheme, path = split_protocol(address)
    if not scheme or not path.strip("/"):
        raise ValueError(
            "the place of results must look like file:///var/lib/ondelette/results or s3://bucket/prefix"
        )
    try:
        fsspec.get_filesystem_class(scheme)
    except ImportError as error:
        raise ValueError(f"results cannot be kept at {scheme}:// here: {error}") from error
    return address


class Blobs:
    """One place. Nothing is connected before it is used; safe to share between threads and across forks.

    Every method raises ResultsUnavailable where the place does not answer.
    """

    def __init__(self, address: str) -> None:
        self._address = address

    def write(self, name: str, content: bytes) -> None:
        """Write a blob, which is whole and on the disk when this returns."""
        with self._reached():
            system, root = self._place()
            with system.open(f"{root}/{name}", "wb") as file:
                file.write(content)
                if isinstance(system, LocalFileSystem):
                    # What refers to it is synced as the broker's settings say; this must not come later.
                    file.flush()
                    os.fsync(file.fileno())
            if isinstance(system, LocalFileSystem):
                _sync_folder(root)

    def read(self, name: str) -> bytes:
        """Return a blob; raises ResultLost where the place is there and the blob is not."""
        with self._reached():
            system, root = self._place()
            try:
                return bytes(system.cat_file(f"{root}/{name}"))
            except FileNotFoundError:
                # A folder that is not mounted must not look like one that has lost something.
                if not system.exists(root):
                    raise
                raise ResultLost(name) from None

    def delete(self, name: str) -> None:
        """Delete a blob if it is there."""
        with self._reached():
            system, root = self._place()
            try:
                system.rm_file(f"{root}/{name}")
            except FileNotFoundError:
                if not system.exists(root):
                    raise

    def probe(self) -> None:
        """Write a blob and delete it again, as whoever asks whether all is well."""
        self.write("probe", b"")
        self.delete("probe")

    def _place(self) -> tuple[fsspec.AbstractFileSystem, str]:
        # Asked anew each time: fsspec keeps its clients, and makes new ones in a process that was forked.
        system, root = url_to_fs(self._address)
        return system, root.rstrip("/")

    @contextlib.contextmanager
    def _reached(self) -> Iterator[None]:
        try:
            yield
        except (ResultLost, MemoryError):
            raise
        except Exception as error:  # Each kind of store has errors of its own.
            raise ResultsUnavailable(f"results at {self._address} cannot be reached: {error}") from error


def _sync_folder(path: str) -> None:
    folder = os.open(path, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
