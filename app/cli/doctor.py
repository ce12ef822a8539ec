"""``ondelette doctor``: what may be wrong with an installation."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.common import ExitCode, cell, tables, to_json
from app.cli.keys import broker_or_embedded, data_option
from app.cli.service import broker_option, load


@click.command(short_help="Look for what may be wrong.")
@broker_option
@data_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def doctor(broker: str | None, data: Path | None, as_json: bool) -> None:
    """Look at this machine, at the broker, and at the service that lives there.

    Exit code 0: nothing is wrong, 1: something is.
    """
    from dataclasses import asdict

    from app.doctor import examine
    from app.settings import Settings

    findings = list(examine(load(Settings, broker_or_embedded(broker, data)), data))
    if as_json:
        click.echo(to_json([asdict(finding) for finding in findings]), nl=False)
    else:
        from rich.table import Table

        table = Table("what", "verdict", "detail")
        for finding in findings:
            table.add_row(finding.what, finding.verdict, cell(finding.detail))
        tables().print(table)
    if any(finding.verdict == "error" for finding in findings):
        raise SystemExit(ExitCode.NOT_SOLVED)
