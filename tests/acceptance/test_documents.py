"""Every example of the README and of the documentation is true: it runs, or is valid, as it is printed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from solvers.catalogue import load_case
from solvers.solve import solve
from solvers.spec import check_document
from tests.acceptance.markdown import (
    ROOT,
    Reader,
    assert_known_commands,
    assert_printed,
    assert_valid,
    blocks_of,
)

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks_of(page)], ids=lambda page: str(page.relative_to(ROOT))
)
def test_what_the_page_says_is_true(page: Path, url: str, broker: str, tmp_path: Path) -> None:
    reader = Reader(tmp_path, url, broker)
    try:
        for block in blocks_of(page):
            try:
                reader.follow(block)
            except Exception as error:
                error.add_note(f"{page.relative_to(ROOT)}, line {block.line}")
                raise
    finally:
        reader.close()


def test_the_reference_of_results_names_every_key() -> None:
    page = (ROOT / "docs" / "reference" / "result.md").read_text()
    always, _, sometimes = page.partition("By [`ga`]")
    told = [set(re.findall(r"`(\w+)`", row)) for row in re.findall(r"^\| (`[^|]+) \|", always, re.MULTILINE)]
    document = load_case("rigid_body")
    document["problem"]["scenarios"] = {"cases": [{"name": "heavy", "parameters": {"m": 1.01}}]}
    document["output"] = {"command": {"period": 0.1}, "coast": 1}
    assert set(solve(check_document(document)).result()) == set.union(*told)
    document = load_case("solar_array_1")
    document["method"] = {
        "name": "ga",
        "population": 8,
        "generations": 2,
        "variant": "classic",
        "polish": False,
    }
    more = set(solve(check_document(document)).result()) - set.union(*told)
    assert all(f"`{name}`" in sometimes for name in more)
    assert more


def test_the_reader_is_not_easily_pleased() -> None:
    with pytest.raises(AssertionError, match=r"printed: 1\.24"):
        assert_printed("1.24\n", "1.26\n")
    with pytest.raises(AssertionError, match="not in the page: two"):
        assert_printed("one\ntwo\n", "one\n")
    with pytest.raises(AssertionError, match="not printed: two"):
        assert_printed("one\n", "one\n...\ntwo\n")
    with pytest.raises(AssertionError, match="no part of a document"):
        assert_valid({"scenarios": {"cases": [{"nom": "soft"}]}})
    with pytest.raises(Exception, match="No such option"):
        assert_known_commands("ondelette serve --prot 1")
