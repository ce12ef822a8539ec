"""``ondelette replay``: the answer of a finished job, verified again without a service."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.common import ExitCode, fail, one_line, tables


@click.command(short_help="Verify the answer in a bundle again.")
@click.argument("bundle", type=click.Path(exists=True, dir_okay=False, path_type=Path))
def replay(bundle: Path) -> None:
    """Fly the answer in BUNDLE (the bundle.zip of a job) again, here and without a service.

    Exit code 0: it passes its verification, and every figure is what the result says; 1: not; 2: the file is
    no bundle.
    """
    from solvers.output.bundle import BundleError, unpack
    from solvers.verification.replay import replay as fly

    try:
        unpacked = unpack(bundle.read_bytes())
        found, result = fly(unpacked), unpacked.result
    except BundleError as error:
        fail(f"{bundle}: {error}", ExitCode.BAD_INPUT)
    from rich.table import Table

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
    if result is not None and not result.get("success"):
        words = f"but the solve was no success: {result.get('status')}: {result.get('message')}"
        click.echo(one_line(words), err=True)
