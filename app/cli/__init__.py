"""The command ``ondelette``: a file a group of commands.

Each command imports what it needs inside its function, so that ``ondelette --help`` answers at once and
nothing but ``solve`` (and ``worker``, whose work it is) ever loads the optimizer.

Exit codes: 0 success, 1 no success (a solve that did not converge, a job that failed), 2 bad input or usage,
3 something broke: no server at the address, a service that cannot start, an error of our own.
"""

from __future__ import annotations

import click

from app.cli.backup import backup, restore
from app.cli.bench import bench
from app.cli.cases import case, cases
from app.cli.common import CommandGroup
from app.cli.demo import demo
from app.cli.doctor import doctor
from app.cli.flights import flights
from app.cli.jobs import cancel, list_jobs, result, submit, watch
from app.cli.keys import keys
from app.cli.replay import replay
from app.cli.report import report
from app.cli.service import api, serve, worker
from app.cli.solve import solve


@click.group(cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="ondelette", prog_name="ondelette")
def main() -> None:
    """Solve optimal-control problems, here or on a server, and verify the answers."""


for command in (
    serve,
    api,
    worker,
    solve,
    replay,
    report,
    flights,
    submit,
    watch,
    result,
    cancel,
    list_jobs,
    cases,
    case,
    keys,
    doctor,
    backup,
    restore,
    demo,
    bench,
):
    main.add_command(command)
