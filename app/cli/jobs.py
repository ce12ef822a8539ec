"""``ondelette submit``, ``watch``, ``result``, ``cancel`` and ``list``: a client of a running server."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import click

from app.cli.common import (
    ExitCode,
    cell,
    describe,
    fail,
    one_line,
    progress_bar,
    tables,
    to_json,
    write_output,
)
from app.cli.documents import read_document
from app.cli.targets import draw, output_option, plot_option

if TYPE_CHECKING:
    from rich.progress import Progress

    from app.client import Client, Job

server_option = click.option(
    "--server",
    envvar="ONDELETTE_SERVER",
    default="http://127.0.0.1:8000",
    show_default=True,
    help="Address of the service (or ONDELETTE_SERVER).",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
progress_option = click.option(
    "--progress/--no-progress", default=None, help="Progress bar on stderr; default: if that is a terminal."
)
# Status of the answer for a job that ended without an iterate.
NO_RESULT = 404


def connect(server: str) -> Client:
    """A client of ``server``, with the key in ``ONDELETTE_KEY``; ends with 2 where that is no address.

    The key is no option: the arguments of a process are seen by all users of a machine.
    """
    import os

    from app.client import Client

    if not server.startswith(("http://", "https://")):
        fail(f"--server must be an http:// or https:// address, not {server!r}", ExitCode.BAD_INPUT)
    return Client(server, key=os.environ.get("ONDELETTE_KEY"))


def follower(bar: Progress) -> Callable[[Job], None]:
    """A function that shows the readings of a job on ``bar``."""
    task = bar.add_task("waiting", total=1.0, state="")

    def show(job: Job) -> None:
        progress = job["progress"]
        fraction = progress["fraction"] if progress else None
        final = job["status"] in ("succeeded", "failed", "cancelled")
        bar.update(
            task, description=job["status"], completed=1.0 if final else fraction, state=describe(progress)
        )

    return show


@click.command(short_help="Queue a document on a server.")
@click.argument("file")
@server_option
@json_option
def submit(file: str, server: str, as_json: bool) -> None:
    """Queue the job document FILE (JSON or YAML, - for stdin); prints the job's id."""
    document = cast(dict[str, Any], read_document(file))
    with connect(server) as client:
        job = client.submit(document)
    click.echo(to_json(job).decode() if as_json else job["id"], nl=not as_json)


@click.command(short_help="Follow a job to its end.")
@click.argument("job_id", metavar="ID")
@server_option
@json_option
@progress_option
def watch(job_id: str, server: str, as_json: bool, progress: bool | None) -> None:
    """Follow job ID until it ends, then print its result in figures; exit code 1 unless it succeeded."""
    from app.client import RequestRefused

    with connect(server) as client:
        with progress_bar(progress) as bar:
            job = client.wait(job_id, on_progress=follower(bar), every=0.5)
        if as_json:
            click.echo(to_json(job), nl=False)
        else:
            try:
                result = client.result(job_id)
            except RequestRefused as error:
                if error.status != NO_RESULT:
                    raise
            else:
                from app.cli.result_table import result_table

                tables().print(result_table(result))
    if job["status"] != "succeeded":
        problem = job["error"]
        reason = f": {problem['detail'] or problem['title']}" if problem else ""
        fail(one_line(f"job {job_id} {job['status']}{reason}"), ExitCode.NOT_SOLVED)


@click.command(short_help="Print the result of a job.")
@click.argument("job_id", metavar="ID")
@server_option
@output_option
@click.option(
    "--format", "kind", type=click.Choice(["json", "csv", "npz", "mat"]), default="json", show_default=True
)
@plot_option
def result(
    job_id: str,
    server: str,
    output: Path | None,
    kind: Literal["json", "csv", "npz", "mat"],
    plot: Path | None,
) -> None:
    """Print the result of job ID; exit code 1 where it was not a success."""
    if output is None and kind in ("npz", "mat") and sys.stdout.isatty():
        fail(f"{kind} is not for a terminal: write it to a file with -o", ExitCode.BAD_INPUT)
    with connect(server) as client:
        answer = client.result(job_id)
        write_output(to_json(answer) if kind == "json" else client.export(job_id, kind), output)
        if plot is not None:
            draw(answer, None, plot)
    if not answer["success"]:
        fail(one_line(f"{answer['status']}: {answer['message']}"), ExitCode.NOT_SOLVED)


@click.command(short_help="Stop a job.")
@click.argument("job_id", metavar="ID")
@server_option
@json_option
def cancel(job_id: str, server: str, as_json: bool) -> None:
    """Ask that job ID be stopped; its last iterate is kept."""
    with connect(server) as client:
        job = client.cancel(job_id)
    click.echo(to_json(job).decode() if as_json else f"{job['id']} {job['status']}", nl=not as_json)


@click.command("list")
@server_option
@json_option
@click.option("--status", type=click.Choice(["queued", "running", "succeeded", "failed", "cancelled"]))
@click.option("--method", help="Only jobs of this method.")
@click.option("--tag", help="Only jobs with this tag.")
@click.option("--name", help="Only jobs of this name.")
@click.option("--limit", type=click.IntRange(1), default=20, show_default=True, help="So many at most.")
def list_jobs(
    server: str,
    as_json: bool,
    status: str | None,
    method: str | None,
    tag: str | None,
    name: str | None,
    limit: int,
) -> None:
    """List jobs, newest first."""
    from itertools import islice

    with connect(server) as client:
        filters = {"status": status, "method": method, "tag": tag, "name": name}
        jobs = list(islice(client.jobs(**filters, limit=min(limit, 100)), limit))
    if as_json:
        sys.stdout.buffer.write(to_json(jobs))
        return
    from rich.table import Table

    table = Table("id", "status", "method", "created", "name")
    table.columns[0].no_wrap = True
    for job in jobs:
        table.add_row(job["id"], job["status"], job["method"], job["created_at"], cell(job["name"] or ""))
    tables().print(table)
