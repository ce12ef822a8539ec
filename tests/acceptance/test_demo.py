"""``ondelette demo`` as a newcomer runs it: one command, a verified answer, nothing left behind."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from app.embedded.broker import DataDirectory


def test_the_demonstration_solves_verifies_draws_and_stops(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "app.cli", "demo"]
    demo = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert (demo.returncode, demo.stderr) == (0, ""), demo.stdout + demo.stderr
    folder = tmp_path / "ondelette-demo"
    result = json.loads((folder / "result.json").read_text())
    assert result["success"] is True
    assert abs(result["objective"] - 25.866100388133) <= 1e-3
    for words in (
        f"{result['objective']:.10g}",
        "25.86610039",
        "switching times of T",
        "terminal error",
        "(limit 0.01) passed",
        "seconds",
        "ondelette-demo/plot.svg",
    ):
        assert words in demo.stdout
    assert "<svg" in (folder / "plot.svg").read_text()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            assert str(tmp_path).encode() not in (process / "cmdline").read_bytes()
        except (FileNotFoundError, ProcessLookupError):
            continue


def test_two_demonstrations_do_not_share_a_folder(tmp_path: Path) -> None:
    taken = DataDirectory(tmp_path / "demo" / "data")
    command = [sys.executable, "-m", "app.cli", "demo", "--folder", str(tmp_path / "demo")]
    demo = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    taken.close()
    assert demo.returncode == 3
    assert "is using the data folder" in demo.stderr
    assert len(demo.stderr.splitlines()) == 1
