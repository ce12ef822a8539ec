"""``ondelette solve``: a job document solved in this process, with neither server nor broker."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.common import ExitCode, describe, fail, progress_bar, to_json, write_output
from app.cli.documents import read_document
from app.cli.targets import draw, output_option, plot_option

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

    from solvers.progress import ProgressReport


class BarProgress:
    """Shows the reports of a solve on a bar; the first Ctrl-C asks the solve to stop."""

    def __init__(self, bar: Bar) -> None:
        self._bar = bar
        self._task = bar.add_task("solving", total=1.0, state="")
        self.interrupted = False

    def report(self, report: ProgressReport) -> None:
        """Move the bar."""
        state = describe(
            {
                "stage": report.stage,
                "iteration": report.iteration,
                "objective": report.objective,
                "infeasibility": report.infeasibility,
            }
        )
        self._bar.update(self._task, completed=report.fraction, state=state)

    def cancelled(self) -> bool:
        """Tell whether Ctrl-C was pressed."""
        return self.interrupted

    def finish(self) -> None:
        """Fill the bar."""
        self._bar.update(self._task, completed=1.0)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Take the first Ctrl-C as a wish to stop (the optimizer would swallow its exception)."""

        def interrupt(number: int, frame: object) -> None:
            self.interrupted = True
            signal.signal(signal.SIGINT, signal.default_int_handler)

        former = signal.signal(signal.SIGINT, interrupt)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, former)


@click.command(short_help="Solve a document in this process.")
@click.argument("file")
@output_option
@plot_option
@click.option(
    "--progress/--no-progress", default=None, help="Progress bar on stderr; default: if that is a terminal."
)
def solve(file: str, output: Path | None, plot: Path | None, progress: bool | None) -> None:
    """Solve the job document FILE (JSON or YAML, - for stdin) in this process.

    The result goes to stdout as JSON. Exit code 0: solved and verified; 1: not, the last iterate is written
    all the same; 2: bad input, one line for each mistake on stderr; 3: an error of our own.
    """
    from solvers.spec import check_document

    spec = check_document(read_document(file))
    from solvers.solve import solve as solve_spec

    with progress_bar(progress) as bar:
        watcher = BarProgress(bar)
        with watcher.interruptible():
            solution = solve_spec(spec, watcher)
        watcher.finish()
    result = solution.result()
    write_output(to_json(result), output)
    if plot is not None:
        draw(result, spec.name, plot)
    if not solution.success:
        fail(f"{solution.status.value}: {solution.message}", ExitCode.NOT_SOLVED)
