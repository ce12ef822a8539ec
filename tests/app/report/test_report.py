"""The report: whole for every method and every end of a job, harmless whatever the names are."""

from __future__ import annotations

import copy
import json
import re
import zlib
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import httpx
import pytest
from click.testing import CliRunner

from app.cli import main
from app.report import write_report
from solvers.output.bundle import pack
from solvers.solve import solve
from solvers.spec import check_document
from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.problems import problem
from tests.solvers.phases.test_phases import BOUNCE
from tests.solvers.piecewise.documents import PENDULUM
from worker.records import JobStatus

Make = Callable[..., str]
CASES = sorted((Path(__file__).parents[3] / "solvers" / "cases").glob("*.json"))
VOID = frozenset({"meta", "br", "mspace", "use", "path"})
RIGID_BODY: dict[str, Any] = {
    "name": "Rigid body",
    "problem": {
        "model": {"kind": "library", "name": "rigid_body"},
        "final_time": [0.5, 10],
        "initial_state": {"*": 0},
        "final_state": {"x": [0.9, 1], "x_dot": [-0.2, 0.2]},
        "bounds": {"u": [-1, 1]},
        "objective": {"terminal": "tf"},
    },
}


class Page(HTMLParser):
    """What a browser would make of a page: its elements, ids, text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.text = ""
        self.open: list[str] = []
        self.feed(html)
        assert self.open == []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for key, value in attributes:
            assert not key.startswith("on"), key
            if key == "id":
                self.ids.append(str(value))
            elif key in ("href", "src", "xlink:href"):
                self.links.append(str(value))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def page_of(html: str) -> Page:
    """A page that loads and runs nothing and stands on its own."""
    page = Page(html)
    assert not {"script", "link", "img", "iframe", "object", "form"} & set(page.tags)
    assert all(link.startswith("#") for link in page.links)
    assert len(page.ids) == len(set(page.ids))
    assert {link[1:] for link in page.links} <= set(page.ids)
    assert not re.search(r"url\((?!#)", html)
    assert "@import" not in html
    return page


def report_of(document: dict[str, Any]) -> tuple[Page, dict[str, Any]]:
    result = solve(check_document(document)).result()
    return page_of(write_report(document, json.loads(json.dumps(result)))), result


METHODS: dict[str, dict[str, Any]] = {
    "swcm": {"name": "swcm", "refine": "switching"},
    "gpm": {"name": "gpm"},
    "hermite_simpson": {"name": "hermite_simpson"},
    "ga": {"name": "ga", "generations": 5, "population": 8},
}


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_every_method_has_its_report(method: dict[str, Any]) -> None:
    page, result = report_of({**RIGID_BODY, "method": method})
    assert page.tags.count("figure") == 1
    for check in result["verification"]["checks"]:
        assert check["name"].replace("_", " ") in page.text
    for words in (
        "Equations of motion",
        "Margins",
        "Sensitivity",
        "Provenance",
        result["resolved"]["sha256"],
    ):
        assert (words in page.text) == (words != "Sensitivity" or bool(result["sensitivity"])), words
    assert f"{result['objective']:.12g}" in page.text
    for found in result["switching"].values():
        for time in found["times"]:
            assert f"{time:.10g}" in page.text


def test_a_mission_in_segments() -> None:
    page, result = report_of(PENDULUM)
    assert "Segments" in page.text
    assert f"{result['segments'][2]['tf']:.6g}" in page.text
    assert "Plant: Equations of motion" in page.text


def test_several_plants_a_command_and_everything_else() -> None:
    document = copy.deepcopy(RIGID_BODY)
    document["problem"] |= {
        "scenarios": {"cases": [{"name": "heavy", "parameters": {"m": 1.05}}], "nominal": True},
        "outputs": [{"name": "power", "expression": "u*x_dot - drag(x_dot)", "units": "W"}],
        "data": {"drag": {"x": [-3, 0, 3], "values": [9, 0, 9]}},
        "integrals": [{"name": "effort", "expression": "u^2"}],
        "path_constraints": [{"name": "soft", "expression": "u*x_dot", "bounds": [None, 3]}],
        "boundary_constraints": [{"expression": "x_f - x_0", "bounds": [0.5, 1.5]}],
    }
    document["output"] = {"command": {"period": 0.1}, "coast": 2}
    page, result = report_of(document)
    assert "m = 1.05" in page.text
    assert f"{result['command']['verification']['states']['x']['error']:.3g}" in page.text
    for words in (
        "Plants under this command",
        "heavy",
        "Command",
        "Coasting",
        "soft",
        "Integrals",
        "Data tables",
    ):
        assert words in page.text, words


def test_a_command_says_what_each_phase_misses() -> None:
    command = {"command": {"period": 0.3}}
    page, result = report_of({**BOUNCE, "method": {"name": "gpm", "nodes": 8}, "output": command})
    for phase in result["command"]["verification"]["phases"]:
        assert phase["name"] in page.text
        assert f"{phase['states']['x']['error']:.3g}" in page.text


@pytest.mark.parametrize("case", CASES, ids=lambda path: str(path.stem))
def test_every_case_can_be_written_down(case: Path) -> None:
    page = page_of(write_report(json.loads(case.read_text()), None))
    assert page.tags.count("math") >= 4
    assert "There is no result" in page.text


def test_names_are_text_whatever_they_say(solved: bytes) -> None:
    document = copy.deepcopy(FLEXIBLE_SPACECRAFT)
    hostile = '"><script>alert(1)</script>&{{ 7*7 }}<!--'
    document |= {"name": hostile, "notes": hostile, "tags": [hostile], "metadata": {hostile: hostile}}
    document["problem"]["units"] = {"theta": "<b>", "T": 'id="x'}
    document["problem"]["path_constraints"] = [{"name": hostile, "expression": "alpha", "bounds": [-1, 1]}]
    result = json.loads(zlib.decompress(solved))
    result["resolved"]["document"] = document
    result["message"] = hostile
    page = page_of(write_report(document, result))
    assert page.text.count("alert(1)") >= 5
    assert "{{ 7*7 }}" in page.text


def test_over_http(client: httpx.Client, job: Make, solved: bytes, diverged: bytes) -> None:
    done = client.get(f"/v1/jobs/{job(JobStatus.SUCCEEDED, solved)}").json()
    answer = client.get(done["links"]["report"])
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert answer.headers["content-security-policy"].startswith("default-src 'none'")
    page = page_of(answer.text)
    assert "Solved and verified" in page.text
    assert done["id"] in page.text
    # Also of an iterate that has no finite number, and of a job that has no iterate.
    for content, words in ((diverged, "States, in their own units"), (None, "Not solved: failed")):
        failed = client.get(f"/v1/jobs/{job(JobStatus.FAILED, content)}/report.html")
        assert words in page_of(failed.text).text
    problem(client.get(f"/v1/jobs/{job()}/report.html"), 409, "not-ready")


def test_on_the_command_line(tmp_path: Path, solved: bytes) -> None:
    result = json.loads(zlib.decompress(solved))
    (tmp_path / "bundle.zip").write_bytes(pack(json.dumps(FLEXIBLE_SPACECRAFT).encode(), {}, result, []))
    run = CliRunner().invoke(main, ["report", str(tmp_path / "bundle.zip")])
    assert run.exit_code == 0, run.output
    assert "Solved and verified" in page_of(run.stdout).text
    (tmp_path / "other.json").write_text("[]")
    run = CliRunner().invoke(main, ["report", str(tmp_path / "other.json")])
    assert run.exit_code == 2
    assert "neither a result" in run.stderr
