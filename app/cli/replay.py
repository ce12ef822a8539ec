"""``ondelette replay``: the answer of a finished job, verified again without a service."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.common import ExitCode, cell, fail, one_line, tables

if TYPE_CHECKING:
    from solvers.output.bundle import Bundle


@click.command(short_help="Verify the answer in a bundle again.")
@click.argument("bundle", type=click.Path(exists=True, dir_okay=False, path_type=Path))
def replay(bundle: Path) -> None:
    """Fly what BUNDLE (the bundle.zip of a job) holds again, here and without a service.

    Exit code 0: it passes its verification, and every figure is what the result says; 1: not; 2: the file is
    no bundle.
    """
    from solvers.output.bundle import BundleError, unpack

    try:
        unpacked = unpack(bundle.read_bytes())
        (_replay_flights if unpacked.of_flights else _replay_answer)(unpacked)
    except BundleError as error:
        fail(f"{bundle}: {error}", ExitCode.BAD_INPUT)


def _replay_answer(bundle: Bundle) -> None:
    from rich.table import Table

    from solvers.verification.replay import replay as fly

    found = fly(bundle)
    table = Table("figure", "as stored", "now", "limit")
    limits = {check.name: check.limit for check in found.verification.checks}
    for name, then, now in found.figures():
        limit = limits.get(name.removeprefix("max_").removesuffix("_violation"))
        table.add_row(name, *("" if value is None else f"{value:.10g}" for value in (then, now, limit)))
    tables().print(table)
    if not found.same_document:
        fail("the result is not of this document: its SHA-256 is another one", ExitCode.NOT_SOLVED)
    if found.differing:
        fail(f"not what the result says: {', '.join(found.differing)}", ExitCode.NOT_SOLVED)
    if not found.verification.passed:
        failed = [check.name for check in found.verification.checks if not check.passed]
        fail(f"the answer does not pass: {', '.join(failed)}", ExitCode.NOT_SOLVED)
    click.echo("verified: the flight is what the result says, and within its limits")
    result = bundle.result
    if result is not None and not result.get("success"):
        words = f"but the solve was no success: {result.get('status')}: {result.get('message')}"
        click.echo(one_line(words), err=True)


def _replay_flights(bundle: Bundle) -> None:
    from rich.table import Table

    from solvers.flights.again import AGREEMENT, flights_again

    differences = flights_again(bundle)
    table = Table("column", "largest difference")
    for name, difference in differences.items():
        table.add_row(cell(name), f"{difference:.3g}")
    tables().print(table)
    differing = [name for name, difference in differences.items() if difference > AGREEMENT]
    if differing:
        fail(one_line(f"not what the result says: {', '.join(differing)}"), ExitCode.NOT_SOLVED)
    click.echo("verified: every flight ends as the result says")
