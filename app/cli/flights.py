"""``ondelette flights``: the answer in a result flown many times, with neither server nor broker."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from app.cli.common import ExitCode, fail, progress_bar, to_json, write_output
from app.cli.documents import read_document
from app.cli.targets import output_option, writable


@click.command(short_help="Fly an answer many times.")
@click.argument("result", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("file")
@output_option
@click.option(
    "--csv",
    "table",
    type=click.Path(path_type=Path),
    callback=writable,
    help="Write a row for each flight here.",
)
@click.option(
    "--progress/--no-progress", default=None, help="Progress bar on stderr; default: if that is a terminal."
)
def flights(result: Path, file: str, output: Path | None, table: Path | None, progress: bool | None) -> None:
    """Fly the answer in RESULT (as ``solve -o`` writes it) as FILE says (JSON or YAML, - for stdin).

    What came of it goes to stdout as JSON. Exit code 0: all flights were flown; 1: not; 2: bad input, one
    line for each mistake on stderr.
    """
    from app.cli.solve import BarProgress
    from solvers.output.export import flights_csv
    from solvers.spec.flights import check_flights

    answered = _answer(result)
    spec = check_flights(read_document(file), answered["resolved"]["document"])
    from solvers.flights.fly import FlightsStopped
    from solvers.flights.run import run_flights
    from solvers.verification.flight import FlightError

    with progress_bar(progress) as bar:
        watcher = BarProgress(bar)
        try:
            with watcher.interruptible():
                flown = run_flights(spec, answered, watcher).result(source=answered.get("job_id"))
        except (FlightsStopped, FlightError) as error:
            fail(str(error), ExitCode.NOT_SOLVED)
        watcher.finish()
    write_output(to_json(flown), output)
    if table is not None:
        write_output(flights_csv(flown).encode(), table)


def _answer(path: Path) -> dict[str, Any]:
    """The result in a file; ends with 2 for what is none, or has no finite trajectory."""
    import json

    from solvers.phases.trajectory import trajectory_of

    try:
        answered = json.loads(path.read_bytes())
        known = trajectory_of(answered).finite and "document" in answered["resolved"]
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        known = False
    if not known:
        fail(f"{path}: this is no result with a trajectory, as ondelette solve writes it", ExitCode.BAD_INPUT)
    return dict(answered)
