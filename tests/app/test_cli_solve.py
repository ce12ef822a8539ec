"""``ondelette solve``: exit codes, what goes where, JSON and YAML, and the table of bad documents."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner, Result

from app.cli import main
from tests.bad_documents import BAD_DOCUMENTS, FLEXIBLE_SPACECRAFT, BadDocument, changed, oversized_body


def ondelette(*arguments: str | Path, stdin: bytes | None = None) -> Result:
    """Run the command in this process."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments], input=stdin)


def run(*arguments: str | Path, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run the command as a process of its own."""
    command = [sys.executable, "-m", "app.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60, **options)


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "good.json"
    path.write_text(json.dumps(FLEXIBLE_SPACECRAFT))
    return path


def test_the_result_goes_to_stdout_and_nothing_to_stderr(good: Path) -> None:
    answer = run("solve", good)
    assert (answer.returncode, answer.stderr) == (0, "")
    result = json.loads(answer.stdout)
    assert result["success"] is True
    assert result["verification"]["passed"] is True
    assert result["objective"] == pytest.approx(25.866, abs=1e-2)


def test_the_result_goes_to_a_file_and_the_plot_beside_it(good: Path, tmp_path: Path) -> None:
    answer = ondelette("solve", good, "-o", tmp_path / "out.json", "--plot", tmp_path / "out.svg")
    assert (answer.exit_code, answer.stdout, answer.stderr) == (0, "", "")
    assert json.loads((tmp_path / "out.json").read_text())["success"] is True
    assert "<svg" in (tmp_path / "out.svg").read_text()


def test_a_document_comes_from_stdin_as_json_or_yaml() -> None:
    texts = (json.dumps(FLEXIBLE_SPACECRAFT), yaml.safe_dump(FLEXIBLE_SPACECRAFT))
    answers = [ondelette("solve", "-", stdin=text.encode()) for text in texts]
    assert [answer.exit_code for answer in answers] == [0, 0]
    of_json, of_yaml = (json.loads(answer.stdout)["resolved"]["sha256"] for answer in answers)
    assert of_json == of_yaml


def test_what_did_not_converge_is_written_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "short.json"
    path.write_text(json.dumps(changed("/options/max_iterations", 2)))
    answer = ondelette("solve", path)
    assert answer.exit_code == 1
    assert answer.stderr.startswith("ondelette: iteration_limit: ")
    assert json.loads(answer.stdout)["success"] is False


def test_progress_is_shown_on_stderr_when_asked(good: Path) -> None:
    answer = run("solve", good, "--progress")
    assert answer.returncode == 0
    assert json.loads(answer.stdout)["success"] is True
    assert "iteration" in answer.stderr


def test_ctrl_c_keeps_the_last_iterate(tmp_path: Path) -> None:
    path = tmp_path / "long.json"
    path.write_text(json.dumps(changed("/method/J", 11)))
    command = [
        sys.executable,
        "-m",
        "app.cli",
        "solve",
        str(path),
        "--progress",
        "-o",
        str(tmp_path / "out.json"),
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        seen = b""
        while b"iteration" not in seen:
            more = process.stderr.read1(4096)
            assert more, "it ended by itself"
            seen += more
        os.kill(process.pid, signal.SIGINT)
        started = time.monotonic()
        rest = process.stderr.read()
    assert process.returncode == 1
    assert time.monotonic() - started < 10
    assert b"ondelette: cancelled: " in rest
    assert json.loads((tmp_path / "out.json").read_text())["status"] == "cancelled"


@pytest.mark.parametrize("bad", BAD_DOCUMENTS, ids=lambda bad: bad.name)
def test_bad_documents_are_refused_in_one_line_for_each_mistake(bad: BadDocument, tmp_path: Path) -> None:
    path = tmp_path / "bad.json"
    path.write_bytes(bad.raw)
    answer = ondelette("solve", path)
    assert answer.exit_code == 2, answer.output
    assert answer.stdout == ""
    lines = answer.stderr.splitlines()
    assert len(lines) >= 1
    assert all(line.startswith("/") and ": " in line for line in lines), lines
    assert max(map(len, lines)) < 2_000
    if bad.pointer:
        assert any(line.startswith(f"{bad.pointer}: ") for line in lines), lines


def test_every_mistake_of_a_document_is_told_at_once(tmp_path: Path) -> None:
    document = changed("/problem/model/mass/0/1", "2*Jc")
    document["problem"]["bounds"]["T"] = [5, -5]
    document["metod"] = 1
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(document))
    answer = run("solve", path)
    assert (answer.returncode, answer.stdout) == (2, "")
    pointers = {line.partition(":")[0] for line in answer.stderr.splitlines()}
    assert pointers == {"/problem/model/mass/0/1", "/problem/bounds/T", "/metod"}
    assert "did you mean" in answer.stderr


def test_names_of_a_document_cannot_command_the_terminal(tmp_path: Path) -> None:
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(changed("/\x1b[2J\nname", 1)))
    answer = ondelette("solve", path)
    assert answer.exit_code == 2
    assert len(answer.stderr.splitlines()) == 1
    assert "\x1b" not in answer.stderr
    assert "\\x1b[2J\\nname" in answer.stderr


def test_a_huge_file_is_refused_without_being_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.writelines(oversized_body())
    for suffix in (".json", ".yaml"):
        answer = ondelette("solve", path.rename(path.with_suffix(suffix)))
        assert answer.exit_code == 2
        assert answer.stderr == "/: the document is longer than 2,097,152 bytes\n"
        path = path.with_suffix(suffix)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\na: 2\n", "/: line 2, column 1: duplicate key 'a'"),
        ("a: {b: 1, b: 2}\n", "/: line 1, column 11: duplicate key 'b'"),
        ("1: 2\n", "/: line 1, column 1: a key must be a text"),
        ("a: &x [1]\nb: *x\n", "/: line 2, column 4: aliases are not supported"),
        ("a: [1, 2\n", "/: line 2, column 1: "),
        ("a: !!python/object/apply:os.system ['true']\n", "/: line 1, column 4: "),
        ("--- {}\n--- {}\n", "/: line 2, column 1: "),
        ("a: \x01\n", "/: "),
        ("[" * 5_000, "/: the document is nested too deeply"),
        ("problem: .nan\n", "/"),
        ("", "/: "),
    ],
)
def test_yaml_that_json_could_not_say_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    answer = ondelette("solve", path)
    assert answer.exit_code == 2, answer.output
    assert answer.stderr.startswith(said)
    assert "Traceback" not in answer.stderr


def test_yaml_scalars_mean_what_they_mean_in_json(tmp_path: Path) -> None:
    from app.cli.documents import read_document

    path = tmp_path / "values.yml"
    path.write_text("[no, on, 1e-8, 12:30, 0x10, 2024-01-01, true, null, ~, -3, .5, 1_000, 5., '']")
    values = read_document(str(path))
    assert values == [
        "no",
        "on",
        1e-8,
        "12:30",
        "0x10",
        "2024-01-01",
        True,
        None,
        None,
        -3,
        0.5,
        "1_000",
        5.0,
        "",
    ]


def test_files_that_cannot_be_used_are_usage_errors(good: Path, tmp_path: Path) -> None:
    missing = ondelette("solve", tmp_path / "missing.json")
    assert (missing.exit_code, missing.stderr) == (
        2,
        f"ondelette: {tmp_path}/missing.json: No such file or directory\n",
    )
    for arguments, said in (
        (["-o", tmp_path / "nowhere" / "out.json"], "does not exist"),
        (["-o", tmp_path], "is a folder"),
        (["--plot", tmp_path / "out.pdf"], "must end with .svg or .png"),
    ):
        answer = ondelette("solve", good, *arguments)
        assert answer.exit_code == 2
        assert said in answer.stderr


def test_the_spacecraft_of_the_tests_is_the_one_on_board() -> None:
    listed = json.loads(ondelette("case", "flexible_spacecraft").stdout)
    assert listed["problem"]["model"]["mass"] == FLEXIBLE_SPACECRAFT["problem"]["model"]["mass"]
