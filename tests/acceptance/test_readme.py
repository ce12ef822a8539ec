"""The examples of the README, run as they are printed, give the answers that are printed under them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
PRINTED_ADDRESS = "http://127.0.0.1:8000"


def block(language: str, beginning: str) -> str:
    """The one block of ``language`` that begins so."""
    found = [text for kind, text in BLOCKS if kind == language and text.startswith(beginning)]
    assert len(found) == 1, (language, beginning)
    return str(found[0])


def masked(job: dict[str, Any]) -> dict[str, Any]:
    """A job without what differs from one to the next; the last progress is kept only of slower ones."""
    text = json.dumps({**job, "progress": None}).replace(job["id"], "ID")
    return dict(json.loads(re.sub(r"\d{4}-\d\d-\d\dT[\d:.]+Z", "TIME", text)))


def test_the_post_is_answered_as_printed(url: str) -> None:
    command = block("sh", "curl").replace(PRINTED_ADDRESS, url)
    answer = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    job, printed = masked(json.loads(answer.stdout)), masked(json.loads(block("json", '{"id"')))
    # What is printed is only the beginning of what is told.
    assert printed.pop("links").items() <= job["links"].items()
    assert printed.items() <= {key: value for key, value in job.items() if key != "links"}.items()


def test_the_python_lines_print_what_is_printed(url: str) -> None:
    program = block("python", "from app.client")
    assert len(program.splitlines()) == 8
    code = program.replace(PRINTED_ADDRESS, url)
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    printed = block("text", "True ")
    assert answer.stdout.startswith("True ")
    numbers, expected = (
        [float(number) for number in re.findall(r"\d+\.\d+", text)] for text in (answer.stdout, printed)
    )
    assert numbers == pytest.approx(expected, rel=1e-6)


def test_the_command_lines_are_commands_of_ours(tmp_path: Path) -> None:
    lines = [line for line in block("sh", ".venv/bin/ondelette cases").splitlines() if "submit" not in line]
    script = "\n".join(lines[:3]).replace(".venv/bin/ondelette", f"{sys.executable} -m app.cli")
    subprocess.run(["bash", "-ec", script], cwd=tmp_path, check=True, capture_output=True)
    assert json.loads((tmp_path / "result.json").read_text())["success"] is True
    assert (tmp_path / "goddard.svg").exists()


def test_the_settings_are_settings() -> None:
    from app.settings import Settings
    from worker.settings import WorkerSettings

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
