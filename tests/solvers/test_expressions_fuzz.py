"""Noise against the parser of expressions, in a process that may have little memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("fuzz_expressions.py")
COUNT = 8_000


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_is_refused_within_little_memory(seed: int) -> None:
    command = [sys.executable, str(SCRIPT), str(COUNT), str(seed)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert run.returncode == 0, run.stderr[-2000:]
    taken, refused = map(int, run.stdout.split())
    assert taken + refused == COUNT
    # Both sides of the border were visited.
    assert taken > 50
    assert refused > COUNT // 2


def test_the_limit_of_memory_holds() -> None:
    """Whoever needs more is stopped: else the test above would prove nothing."""
    code = (
        "import runpy, resource; space = runpy.run_path(__import__('sys').argv[1]);"
        "space['main'](70, 1); bytearray(space['MEMORY'] + 2**20)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(SCRIPT)], capture_output=True, text=True, check=False, timeout=60
    )
    assert run.returncode != 0
    assert "MemoryError" in run.stderr
