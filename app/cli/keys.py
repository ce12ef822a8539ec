"""``ondelette keys``: who may use a service. Works on the broker, with no API in between."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.common import ExitCode, cell, fail, tables, to_json
from app.cli.service import broker_option, load

if TYPE_CHECKING:
    from worker.keys import KeyStore

SCOPES = ("submit", "read", "cancel", "metrics", "admin")
_DAY = 86_400

data_option = click.option(
    "--data",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of a service that ondelette serve runs with a broker of its own.",
)


def broker_or_embedded(broker: str | None, data: Path | None) -> str | None:
    """The address of the broker that is named, or of the one embedded in ``data``; None for neither."""
    from app.embedded.broker import address_of

    if data is None:
        return broker
    if broker is not None:
        fail("give either --broker or --data", ExitCode.BAD_INPUT)
    address = address_of(data)
    if address is None:
        fail(f"no service has kept its data in {data}", ExitCode.BAD_INPUT)
    return address


def open_store(broker: str | None, data: Path | None) -> KeyStore:
    """The keys of the broker that is named, or of the one that is embedded in ``data``."""
    from worker.keys import KeyStore
    from worker.settings import QueueSettings
    from worker.store import connect

    settings = load(QueueSettings, broker_or_embedded(broker, data))
    return KeyStore(connect(settings), settings)


@click.group(short_help="Make, list and revoke API keys.")
def keys() -> None:
    """Make, list and revoke API keys. As soon as there is one, nobody enters without."""


@keys.command(short_help="Make a key.")
@click.argument("name")
@click.option("--project", default="default", show_default=True, help="Whose jobs it submits and sees.")
@click.option(
    "--scope",
    "scopes",
    type=click.Choice(SCOPES),
    multiple=True,
    default=("submit", "read", "cancel"),
    show_default=True,
    help="What it allows; may be given more than once.",
)
@click.option("--days", type=click.FloatRange(0, min_open=True), help="Days after which it expires.")
@broker_option
@data_option
def create(
    name: str,
    project: str,
    scopes: tuple[str, ...],
    days: float | None,
    broker: str | None,
    data: Path | None,
) -> None:
    """Make a key for NAME and print it. It is shown this once only."""
    from worker.keys import Scope

    expires_at = None if days is None else time.time() + days * _DAY
    try:
        record, key = open_store(broker, data).create(name, project, map(Scope, scopes), expires_at)
    except ValueError as error:
        fail(f"--project: {error}", ExitCode.BAD_INPUT)
    click.echo(f"key {record.id} of project {record.project}; keep it, it is not shown again", err=True)
    click.echo(key)


@keys.command("list", short_help="List the keys.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@broker_option
@data_option
def list_keys(as_json: bool, broker: str | None, data: Path | None) -> None:
    """List all keys, without their secrets."""
    from rich.table import Table

    from worker.records import timestamp

    records = open_store(broker, data).list()
    now = time.time()
    rows = [
        {
            "id": record.id,
            "prefix": record.prefix,
            "name": record.name,
            "project": record.project,
            "scopes": sorted(record.scopes),
            "created_at": timestamp(record.created_at),
            "expires_at": None if record.expires_at is None else timestamp(record.expires_at),
            "valid": record.valid(now),
        }
        for record in records
    ]
    if as_json:
        click.echo(to_json(rows), nl=False)
        return
    table = Table("id", "name", "project", "scopes", "created", "expires", "state")
    for record, row in zip(records, rows, strict=True):
        state = "valid" if row["valid"] else "expired" if record.revoked_at is None else "revoked"
        table.add_row(
            record.id,
            cell(record.name),
            record.project,
            " ".join(sorted(record.scopes)),
            str(row["created_at"]),
            str(row["expires_at"] or ""),
            state,
        )
    tables().print(table)


@keys.command(short_help="Take a key's effect away.")
@click.argument("key_id", metavar="ID")
@broker_option
@data_option
def revoke(key_id: str, broker: str | None, data: Path | None) -> None:
    """Revoke the key with this ID (as keys list shows it), for good and within seconds."""
    from worker.keys import KeyUnknown

    try:
        record = open_store(broker, data).revoke(key_id)
    except KeyUnknown as error:
        fail(str(error), ExitCode.BAD_INPUT)
    click.echo(f"key {record.id} is revoked")
