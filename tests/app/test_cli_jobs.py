"""``ondelette submit``, ``watch``, ``result``, ``cancel``, ``list``, ``cases`` and ``case``."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from app.cli import main
from solvers.catalogue import case_names, load_case
from solvers.spec import check_document
from tests.bad_documents import FLEXIBLE_SPACECRAFT, changed


@pytest.fixture(autouse=True)
def server(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ONDELETTE_SERVER", url)


def ondelette(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def submitted(tmp_path: Path, document: object) -> str:
    """Submit a document; returns the id that was printed."""
    path = tmp_path / "job.json"
    path.write_text(json.dumps(document))
    answer = ondelette("submit", path)
    assert answer.exit_code == 0, answer.output
    return answer.stdout.strip()


def test_a_job_from_submit_to_result(tmp_path: Path) -> None:
    job = submitted(tmp_path, FLEXIBLE_SPACECRAFT)
    watched = ondelette("watch", job)
    assert watched.exit_code == 0, watched.output
    assert "solved and verified (converged)" in watched.stdout
    assert "25.866" in watched.stdout
    assert watched.stderr == "", "no bar where nobody looks"
    result = ondelette("result", job, "--plot", tmp_path / "plot.png")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["job_id"] == job
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")
    for kind, head in (("csv", b"t,"), ("npz", b"PK"), ("mat", b"MATLAB")):
        assert ondelette("result", job, "--format", kind, "-o", tmp_path / kind).exit_code == 0
        assert (tmp_path / kind).read_bytes().startswith(head)


def test_a_job_that_fails_says_why_and_ends_with_1(tmp_path: Path) -> None:
    job = submitted(tmp_path, changed("/options/max_iterations", 2))
    watched = ondelette("watch", job, "--progress")
    assert watched.exit_code == 1
    assert "not solved (iteration_limit)" in watched.stdout
    assert f"ondelette: job {job} failed: " in watched.stderr
    result = ondelette("result", job)
    assert result.exit_code == 1
    assert json.loads(result.stdout)["success"] is False
    assert result.stderr.startswith("ondelette: iteration_limit: ")


def test_a_job_is_cancelled(tmp_path: Path) -> None:
    job = submitted(tmp_path, changed("/method/J", 10))
    cancelled = ondelette("cancel", job)
    assert cancelled.exit_code == 0
    assert cancelled.stdout.startswith(job)
    watched = ondelette("watch", job, "--json")
    assert watched.exit_code == 1
    assert json.loads(watched.stdout)["status"] == "cancelled"


def test_jobs_are_listed_as_a_table_and_as_json(tmp_path: Path) -> None:
    named = changed("/name", "[bold]not markup[/bold]\x1b[31m")
    job = submitted(tmp_path, named)
    assert ondelette("watch", job).exit_code == 0
    table = ondelette("list", "--limit", "5")
    assert table.exit_code == 0
    assert job in table.stdout
    assert r"[bold]not markup[/bold]\x1b[31m" in table.stdout
    listed = json.loads(ondelette("list", "--json", "--status", "succeeded", "--limit", "1").stdout)
    assert [entry["id"] for entry in listed] == [job]


def test_a_result_that_is_not_ready_is_told_so(tmp_path: Path) -> None:
    job = submitted(tmp_path, changed("/method/J", 10))
    early = ondelette("result", job)
    assert early.exit_code == 1
    assert early.stdout == ""
    assert early.stderr.startswith("ondelette: ")
    ondelette("cancel", job)
    ondelette("watch", job)


def test_the_mistakes_of_a_document_are_told_as_solve_tells_them(tmp_path: Path) -> None:
    document = changed("/problem/bounds/T", [5, -5])
    document["metod"] = 1
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(document))
    here, there = ondelette("solve", path), ondelette("submit", path)
    assert (here.exit_code, there.exit_code) == (2, 2)
    assert sorted(here.stderr.splitlines()) == sorted(there.stderr.splitlines())


@pytest.mark.parametrize("command", ["watch", "result", "cancel"])
def test_an_unknown_job_is_bad_input(command: str) -> None:
    answer = ondelette(command, "01980000-0000-7000-8000-000000000000")
    assert answer.exit_code == 2
    assert len(answer.stderr.splitlines()) == 1


@pytest.mark.parametrize("command", [["list"], ["watch", "1"], ["result", "1"], ["cancel", "1"]])
def test_without_a_server_one_line_says_so(command: list[str]) -> None:
    started = time.monotonic()
    answer = ondelette(*command, "--server", "http://127.0.0.1:9")
    assert answer.exit_code == 3
    assert answer.stderr.startswith("ondelette: no answer from http://127.0.0.1:9")
    assert len(answer.stderr.splitlines()) == 1
    assert time.monotonic() - started < 5


def test_an_address_that_is_none_is_bad_input() -> None:
    answer = ondelette("list", "--server", "localhost:8000")
    assert answer.exit_code == 2
    assert "http://" in answer.stderr


def test_the_cases_on_board_are_listed_and_printed() -> None:
    table = ondelette("cases")
    assert table.exit_code == 0
    for name in case_names():
        assert name in table.stdout
        printed = ondelette("case", name)
        assert printed.exit_code == 0
        assert json.loads(printed.stdout) == load_case(name)
        check_document(json.loads(printed.stdout))
    assert [entry["name"] for entry in json.loads(ondelette("cases", "--json").stdout)] == list(case_names())


def test_an_unknown_case_gets_a_suggestion() -> None:
    answer = ondelette("case", "flexible_spacecaft")
    assert answer.exit_code == 2
    assert answer.stderr == "ondelette: no case 'flexible_spacecaft'; did you mean 'flexible_spacecraft'?\n"
    assert "rigid_body" in ondelette("case", "xyz").stderr


def test_unknown_benchmarks_are_refused() -> None:
    answer = ondelette("bench", "nothing")
    assert answer.exit_code == 2
    assert len(answer.stderr.splitlines()) == 1


def test_benchmarks_read_no_arguments_but_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cases.py").write_text("import sys\nprint(sys.argv[1:])\n")
    # As an attribute of its package `bench` is the command.
    monkeypatch.setattr(sys.modules["app.cli.bench"], "FOLDER", tmp_path)
    # pytest has arguments of its own: here are those of a call.
    monkeypatch.setattr(sys, "argv", ["ondelette", "bench", "cases"])
    assert ondelette("bench", "cases").output == "[]\n"
