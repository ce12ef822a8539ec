"""What the README says besides its examples: settings with their defaults, and links."""

from __future__ import annotations

import re
from pathlib import Path

from app.settings import Settings
from worker.settings import WorkerSettings

ROOT = Path(__file__).parents[2]


def test_the_settings_are_settings() -> None:
    rows = re.findall(
        r"^\| `ONDELETTE_(\w+)` \|.*\| (.*) \|$", (ROOT / "README.md").read_text(), re.MULTILINE
    )
    assert len(rows) >= 5
    for name, default in rows:
        owner = Settings if name.lower() in Settings.model_fields else WorkerSettings
        real = owner.model_fields[name.lower()].default
        assert default.strip("`") == (
            "none" if real in ((), None) else f"{real:g}" if isinstance(real, float) else str(real)
        )


def test_the_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\((?!http)([^)]+)\)", (ROOT / "README.md").read_text()):
        assert (ROOT / target).exists(), target
