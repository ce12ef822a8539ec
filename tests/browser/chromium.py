"""Which browser there is, and how it is started."""

from __future__ import annotations

import os
import shutil

ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]

_PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


def find_chromium() -> str | None:
    """The one that ONDELETTE_BROWSER names, else the first one on the search path; None if there is none."""
    return os.environ.get("ONDELETTE_BROWSER") or next(filter(None, map(shutil.which, _PROGRAMS)), None)
