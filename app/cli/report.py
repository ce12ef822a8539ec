"""``ondelette report``: a result as a printable page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from app.cli.common import ExitCode, fail, write_output
from app.cli.targets import output_option


@click.command(short_help="Write the printable report of a result.")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@output_option
def report(file: Path, output: Path | None) -> None:
    """Write the report of FILE, a result as JSON or the bundle.zip of a job: one HTML file, to be printed.

    Exit code 2 where the file is neither.
    """
    from app.report import write_report

    document, result = _read(file)
    write_output(write_report(document, result).encode(), output)


def _read(file: Path) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """The document and the result."""
    from solvers.output.bundle import BundleError, unpack

    content = file.read_bytes()
    if content.startswith(b"PK"):
        try:
            bundle = unpack(content)
        except BundleError as error:
            fail(f"{file}: {error}", ExitCode.BAD_INPUT)
        if bundle.of_flights:
            fail(f"{file}: flights have no report of their own", ExitCode.BAD_INPUT)
        return json.loads(bundle.document), None if bundle.result is None else dict(bundle.result)
    try:
        result: dict[str, Any] = json.loads(content)
        return result["resolved"]["document"], result
    except (ValueError, KeyError, TypeError):
        fail(f"{file}: this is neither a result as JSON nor a bundle", ExitCode.BAD_INPUT)
