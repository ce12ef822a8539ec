"""Bundles: what is packed comes back, and an answer is confirmed or not."""

from __future__ import annotations

import copy
import io
import json
import zipfile
from typing import Any

import pytest
from click.testing import CliRunner

from app.cli import main
from solvers.output.bundle import BundleError, pack, unpack
from solvers.solve import solve
from solvers.spec import check_document
from solvers.verification.replay import replay
from tests.bad_documents import FLEXIBLE_SPACECRAFT

DOCUMENT = json.dumps(FLEXIBLE_SPACECRAFT, indent=1).encode()


@pytest.fixture(scope="module")
def answer() -> dict[str, Any]:
    return solve(check_document(FLEXIBLE_SPACECRAFT)).result("a job")


def packed(result: dict[str, Any] | None, document: bytes = DOCUMENT) -> bytes:
    return pack(document, {"id": "a job"}, result, ["first", "second"])


def test_a_bundle_holds_everything(answer: dict[str, Any]) -> None:
    raw = packed(answer)
    assert unpack(raw).document == DOCUMENT
    assert unpack(raw).result == answer
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        assert archive.read("log.txt") == b"first\nsecond\n"
        assert json.loads(archive.read("versions.json")) == answer["provenance"]
        assert json.loads(archive.read("options.json")) == answer["resolved"]
        assert json.loads(archive.read("job.json")) == {"id": "a job"}


def test_an_answer_is_confirmed(answer: dict[str, Any]) -> None:
    found = replay(unpack(packed(answer)))
    assert found.confirmed
    for name, then, now in found.figures():
        assert now == pytest.approx(then, abs=1e-9), name


def test_penalised_ends_are_no_conditions_when_flown_again(answer: dict[str, Any]) -> None:
    document = copy.deepcopy(FLEXIBLE_SPACECRAFT)
    document["method"] = {"name": "ga", "population": 8, "generations": 3, "polish": False}
    raw = json.dumps(document).encode()
    result = solve(check_document(document)).result("a job")
    assert result["residual"] > 0.01
    found = replay(unpack(packed(result, raw)))
    assert found.differing == []
    stored = {check["name"]: check for check in result["verification"]["checks"]}
    assert {check.name for check in found.verification.checks} == set(stored)
    for check in found.verification.checks:
        assert check.value == pytest.approx(stored[check.name]["value"], abs=1e-9), check.name


def test_another_control_is_found_out(answer: dict[str, Any]) -> None:
    forged = copy.deepcopy(answer)
    control = forged["nodes"]["controls"]["T"]
    control[:] = [0.9 * value for value in control]
    found = replay(unpack(packed(forged)))
    assert not found.confirmed
    assert "terminal_error" in found.differing
    assert not found.verification.passed


def test_a_prettier_figure_is_found_out(answer: dict[str, Any]) -> None:
    forged = copy.deepcopy(answer)
    forged["verification"]["terminal_error"] = 1e-9
    found = replay(unpack(packed(forged)))
    assert found.verification.passed
    assert found.differing == ["terminal_error"]
    assert not found.confirmed


def test_another_document_is_found_out(answer: dict[str, Any]) -> None:
    other = json.dumps({**FLEXIBLE_SPACECRAFT, "notes": "changed"}).encode()
    assert not replay(unpack(packed(answer, other))).same_document


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"PK\x03\x04",
        pack(b"{}", {}, None, [])[:-30],
        b"no archive at all",
    ],
)
def test_what_is_no_bundle(raw: bytes) -> None:
    with pytest.raises(BundleError):
        unpack(raw)


def test_a_bundle_without_its_parts(answer: dict[str, Any]) -> None:
    with pytest.raises(BundleError, match="no result"):
        replay(unpack(packed(None)))
    with zipfile.ZipFile(io.BytesIO(packed(None))) as archive:
        about = archive.read("README.txt").decode()
        assert [line.split()[0] for line in about.splitlines() if ".json" in line] == [
            name for name in archive.namelist() if name.endswith(".json")
        ]
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("result.json", "{}")
    with pytest.raises(BundleError, match=r"document\.json"):
        unpack(buffer.getvalue())
    for result in ({**answer, "nodes": {}}, {**answer, "coefficients": {"basis": {"name": "new"}}}):
        with pytest.raises(BundleError, match="cannot be read"):
            replay(unpack(packed(result)))


def test_the_command(answer: dict[str, Any], tmp_path: Any) -> None:
    file = tmp_path / "bundle.zip"
    file.write_bytes(packed(answer))
    run = CliRunner().invoke(main, ["replay", str(file)])
    assert run.exit_code == 0, run.output
    assert "verified" in run.output
    assert f"{answer['verification']['terminal_error']:.10g}" in run.output
    forged = copy.deepcopy(answer)
    forged["verification"]["max_state_error"] = 0.0
    file.write_bytes(packed(forged))
    run = CliRunner().invoke(main, ["replay", str(file)])
    assert run.exit_code == 1
    assert "max_state_error" in run.output
    file.write_bytes(b"nothing")
    assert CliRunner().invoke(main, ["replay", str(file)]).exit_code == 2
