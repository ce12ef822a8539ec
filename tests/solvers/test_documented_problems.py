"""The complete job documents in the page about problems are solved as they stand there."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from solvers.solve import solve
from solvers.spec import check_document

PAGE = Path(__file__).parents[2] / "docs" / "problems.md"
BLOCKS = re.findall(r"```json\n(\{.*?\n\})\n```", PAGE.read_text(), re.DOTALL)
DOCUMENTS = [json.loads(block) for block in BLOCKS]


def test_the_page_has_documents() -> None:
    assert len(DOCUMENTS) >= 2


@pytest.mark.parametrize("document", DOCUMENTS)
def test_document_is_solved_and_verified(document: dict[str, Any]) -> None:
    solution = solve(check_document(document))
    assert solution.success, solution.message
