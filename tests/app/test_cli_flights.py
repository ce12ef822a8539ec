"""``ondelette flights``: an answer from a file flown many times, without a service."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from app.cli import main
from solvers.solve import solve
from solvers.spec import check_document
from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.solvers.phases.test_phases import SLIDE_AND_ROLL


def ondelette(*arguments: str | Path, stdin: str | None = None) -> Result:
    """Run the command in this process."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments], input=stdin)


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flights") / "result.json"
    path.write_text(json.dumps(solve(check_document(FLEXIBLE_SPACECRAFT)).result()))
    return path


def test_flights_from_a_file(answer: Path, tmp_path: Path) -> None:
    asked = tmp_path / "asked.yaml"
    asked.write_text("runs: 4\nparameters: {k: {uniform: [90, 110]}}\n")
    told = ondelette("flights", answer, asked, "--csv", tmp_path / "runs.csv")
    assert told.exit_code == 0, told.output
    result: dict[str, Any] = json.loads(told.stdout)
    assert (result["runs"], len(result["columns"]["alpha_f"])) == (4, 4)
    lines = (tmp_path / "runs.csv").read_text().splitlines()
    assert lines[0].startswith("run,k,theta_f,")
    assert float(lines[1].split(",")[1]) == result["columns"]["k"][0]


def test_an_answer_with_phases(tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_text(json.dumps(solve(check_document(SLIDE_AND_ROLL)).result()))
    told = ondelette("flights", file, "-", stdin='{"runs": 2}')
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)["runs"] == 2


def test_bad_input_is_told_line_by_line(answer: Path, tmp_path: Path) -> None:
    told = ondelette("flights", answer, "-", stdin='{"runs": 0, "parameters": {"K": {"values": [1]}}}')
    assert told.exit_code == 2
    assert told.stderr.splitlines() == [
        "/runs: must be at least 1, not 0",
        "/parameters/K: unknown parameter 'K'; did you mean 'k'?",
    ]
    other = tmp_path / "other.json"
    other.write_text('{"success": true}')
    told = ondelette("flights", other, "-", stdin="{}")
    assert (told.exit_code, "no result with a trajectory" in told.stderr) == (2, True)


def test_not_enough_time(answer: Path) -> None:
    told = ondelette("flights", answer, "-", stdin='{"runs": 10000, "coast": 1e6, "max_seconds": 0.1}')
    assert told.exit_code == 1
    assert "time limit" in told.stderr
