"""What tables of a report are made of. Cells are text, or MathML that is marked as such."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from app.report.mathml import inline, name

Result = Mapping[str, Any]

# Longer tables are for files, not for paper.
MOST_ROWS = 60


@dataclass(frozen=True)
class Table:
    """A table with its caption; ``note`` stands below it."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


def figure(value: Any, digits: int = 6) -> str:
    """A number for people; what is not known is a dash."""
    if value is None:
        return "–"  # noqa: RUF001 - a dash, as it stands in printed tables
    return f"{value:.{digits}g}" if isinstance(value, int | float) else str(value)


def symbol(text: str) -> Markup:
    """A name as MathML."""
    return inline(name(text))


def cut(table: Table) -> Table:
    """The first rows of a long table, and how many there are."""
    left = len(table.rows) - MOST_ROWS
    if left <= 0:
        return table
    note = f"{table.note} {left} more rows are in the result.".strip()
    return Table(table.caption, table.head, table.rows[:MOST_ROWS], note)


def verdict(passed: bool | None) -> str:
    """A check's end in a word that is seen on paper."""
    return "passed" if passed else "FAILED"
