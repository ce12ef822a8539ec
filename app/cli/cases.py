"""``ondelette cases`` and ``ondelette case``: the job documents on board."""

from __future__ import annotations

import difflib
import re
import sys

import click

from app.cli.common import ExitCode, fail, tables, to_json


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def cases(as_json: bool) -> None:
    """List the problems on board."""
    from solvers.catalogue import case_names, load_case

    documents = {name: load_case(name) for name in case_names()}
    if as_json:
        listed = [{"name": name, "title": document.get("name")} for name, document in documents.items()]
        sys.stdout.buffer.write(to_json(listed))
        return
    from rich.table import Table

    table = Table("case", "what", "method", "reference objective")
    table.columns[0].no_wrap = True
    for name, document in documents.items():
        objective = (document.get("reference") or {}).get("objective")
        method = (document.get("method") or {}).get("name", "auto")
        table.add_row(
            name, document.get("name", ""), method, "" if objective is None else f"{objective:.10g}"
        )
    tables().print(table)


@click.command()
@click.argument("name")
def case(name: str) -> None:
    """Print the document of case NAME, ready to solve or to POST."""
    from solvers.catalogue import case_names, load_case

    names = case_names()
    if name not in names:
        close = difflib.get_close_matches(name, names, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(names)}."
        fail(f"no case {name!r}; {hint}", ExitCode.BAD_INPUT)
    click.echo(_readable_json(load_case(name)))


def _readable_json(value: object) -> str:
    """Indented JSON with each innermost list in one line, as matrices are written."""
    import json

    text = json.dumps(value, indent=2, ensure_ascii=False)
    # A line break inside brackets is never part of a text: there it would be written \\n.
    return re.sub(r"\[\n\s+([^\[\]{}]*?)\n\s+\]", _joined, text)


def _joined(match: re.Match[str]) -> str:
    return "[" + re.sub(r"\n\s+", " ", match.group(1)) + "]"
