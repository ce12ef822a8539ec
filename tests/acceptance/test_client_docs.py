"""The examples of pages about the client, run in order as they are printed, print what stands under them."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"-?\d+\.\d*(?:e[-+]?\d+)?")


@pytest.mark.parametrize(("page", "file"), [("client.md", "slew.pdf"), ("flights.md", "flights.csv")])
def test_the_examples_print_what_is_printed(
    page: str, file: str, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    said = ""
    try:
        for kind, text in BLOCK.findall((DOCS / page).read_text()):
            if kind == "python":
                with contextlib.redirect_stdout(io.StringIO()) as out:
                    exec(compile(text.replace("http://127.0.0.1:8000", url), page, "exec"), names)
                said = out.getvalue()
            elif kind == "text":
                assert NUMBER.sub("#", said) == NUMBER.sub("#", text)
                for found, printed in zip(NUMBER.findall(said), NUMBER.findall(text), strict=True):
                    # To the digits that are printed.
                    decimals = len(printed.partition(".")[2])
                    assert float(found) == pytest.approx(float(printed), abs=10.0**-decimals), text
    finally:
        names["client"].close()
    assert (tmp_path / file).stat().st_size > 1000
