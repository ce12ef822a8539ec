"""The page that is in the package is the one that its sources give."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUILT = ROOT / "app" / "page" / "static"


def test_the_page_is_built_from_its_sources(tmp_path: Path) -> None:
    if shutil.which("npm") is None:
        pytest.skip("there is no Node.js here to build the page with")
    sources = tmp_path / "page"
    shutil.copytree(ROOT / "page", sources, ignore=shutil.ignore_patterns("node_modules"))

    def npm(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(["npm", *words], cwd=sources, capture_output=True, text=True, check=False)

    installed = npm("ci", "--no-audit", "--no-fund", "--prefer-offline")
    if installed.returncode != 0 and "network" in installed.stderr:
        pytest.skip("the registry of npm is not reached from here")
    assert installed.returncode == 0, installed.stderr
    for command in (("run", "check"), ("run", "build", "--", str(tmp_path / "static"))):
        done = npm(*command)
        assert done.returncode == 0, done.stdout + done.stderr
    fresh = {file.name: file.read_bytes() for file in (tmp_path / "static").iterdir()}
    kept = {file.name: file.read_bytes() for file in BUILT.iterdir()}
    assert fresh.keys() == kept.keys()
    assert [name for name in fresh if fresh[name] != kept[name]] == [], (
        "run make page, and commit what it builds"
    )


def test_the_lock_names_no_registry() -> None:
    assert '"resolved"' not in (ROOT / "page" / "package-lock.json").read_text()


def test_the_licence_of_every_library_comes_with_it() -> None:
    text = (BUILT / "LICENSES.txt").read_text()
    for name in ("preact", "d3-scale", "d3-shape", "@codemirror/view", "eventsource", "@lezer/common"):
        assert f"\n{name} " in text
