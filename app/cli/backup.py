"""``ondelette backup`` and ``restore``: everything that is remembered, in a file and back."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.common import ExitCode, fail
from app.cli.keys import broker_or_embedded, data_option
from app.cli.service import broker_option, load
from app.cli.targets import writable


@click.command(short_help="Write all jobs, results and keys to a file.")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path), callback=writable)
@broker_option
@data_option
def backup(file: Path, broker: str | None, data: Path | None) -> None:
    """Write everything that the service remembers to FILE, while it runs."""
    from worker.backup import write_backup
    from worker.errors import ResultsUnavailable
    from worker.settings import QueueSettings
    from worker.store import JobStore, connect

    settings = load(QueueSettings, broker_or_embedded(broker, data))
    # What is there is replaced only by a whole backup.
    unfinished = file.with_name(f"{file.name}.part")
    unfinished.unlink(missing_ok=True)
    # All documents and results of all projects: nobody else's to read.
    unfinished.touch(mode=0o600)
    with connect(settings) as redis:
        try:
            jobs = write_backup(JobStore(redis, settings), unfinished)
        except ResultsUnavailable as error:
            fail(str(error), ExitCode.BROKEN)
    unfinished.replace(file)
    click.echo(f"{jobs} jobs, {file.stat().st_size:,} bytes in {file}")


@click.command(short_help="Put a backup back.")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@broker_option
@data_option
def restore(file: Path, broker: str | None, data: Path | None) -> None:
    """Put what FILE holds back into a running service; what is there stays as it is."""
    from worker.backup import BackupError, restore_backup
    from worker.errors import ResultsUnavailable
    from worker.settings import QueueSettings
    from worker.store import JobStore, connect

    settings = load(QueueSettings, broker_or_embedded(broker, data))
    with connect(settings) as redis:
        try:
            restored, present = restore_backup(JobStore(redis, settings), file)
        except BackupError as error:
            fail(str(error), ExitCode.BAD_INPUT)
        except ResultsUnavailable as error:
            fail(str(error), ExitCode.BROKEN)
    click.echo(f"{restored} jobs put back, {present} were there")
