"""``ondelette demo``: the service, one job of the literature, and its verified answer, in one command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.common import ExitCode, fail, progress_bar, tables, to_json
from app.cli.jobs import follower

if TYPE_CHECKING:
    from app.embedded.service import EmbeddedService

Document = dict[str, Any]
CASE = "flexible_spacecraft"


@click.command(short_help="See the service solve a spacecraft slew.")
@click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("ondelette-demo"),
    show_default=True,
    help="Where the service keeps its data, and where result and plot are written.",
)
@click.option(
    "--progress/--no-progress", default=None, help="Progress bar on stderr; default: if that is a terminal."
)
def demo(folder: Path, progress: bool | None) -> None:
    """Start the service, solve the flexible-spacecraft slew over HTTP, print the answer, stop."""
    from app.cli.result_table import result_table
    from app.embedded.service import EmbeddedService, ServiceOptions, ServiceStopped, StopRequest

    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "service.log"
    with log.open("wb") as output:
        options = ServiceOptions(folder / "data", port=0, workers=1, output=output)
        click.echo("starting API, worker and broker")
        try:
            with EmbeddedService(options, click.echo, StopRequest()) as service:
                document, result, plot = _solve_case(service, progress)
        except ServiceStopped:
            fail("interrupted", ExitCode.NOT_SOLVED)
    (folder / "result.json").write_bytes(to_json(result))
    (folder / "plot.svg").write_bytes(plot)
    console = tables()
    console.print(result_table(result, document.get("reference")))
    click.echo(f"plot     {folder / 'plot.svg'}")
    click.echo(f"result   {folder / 'result.json'}")
    click.echo(f"log      {log}")
    if not result["success"]:
        fail(f"not solved: {result['message']}", ExitCode.NOT_SOLVED)


def _solve_case(service: EmbeddedService, progress: bool | None) -> tuple[Document, Document, bytes]:
    """Solve the case over HTTP; returns its document, its result and its plot."""
    from app.client import Client, Job

    with Client(service.url) as client, progress_bar(progress) as bar:
        document = client.case(CASE)
        click.echo(f"POST     {service.url}/v1/jobs   ({document['name']})")
        show = follower(bar)

        def look_after(job: Job) -> None:
            service.poll()
            show(job)

        result = client.solve(document, on_progress=look_after, every=0.1)
        return document, result, client.plot(result["job_id"])
