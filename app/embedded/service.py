"""The whole service in one process tree: broker, worker, API; stopped in the reverse order."""

from __future__ import annotations

import contextlib
import signal
import socket
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from app.embedded.binary import find_server
from app.embedded.broker import DataDirectory, EmbeddedBroker, Fsync
from app.embedded.errors import ServiceStartError
from app.embedded.supervisor import ChildSpec, Supervisor
from solvers.errors import OndeletteError
from worker.settings import WorkerSettings

# How long each may take to stop, in seconds: the API drops waiting clients after 2 s, the broker writes its
# file, and the worker has its setting for finishing or handing back its jobs, and this much more.
API_GRACE, WORKER_MARGIN, BROKER_GRACE = 3.0, 3.5, 3.0
BROKER_VARIABLE = "ONDELETTE_BROKER"


@dataclass(frozen=True, slots=True)
class ServiceOptions:
    """What ``ondelette serve`` is asked for.

    ``port`` 0 takes a free one; ``broker`` is the address of a running broker (then none is started and
    ``data`` and ``binary`` are not used); ``keys_needed`` lets nobody enter without an API key; ``output`` is
    where the processes write (default: where we write).
    """

    data: Path
    host: str = "127.0.0.1"
    port: int = 8000
    workers: int | None = None
    broker: str | None = None
    binary: str | None = None
    keys_needed: bool = False
    fsync: Fsync = "everysec"
    output: IO[bytes] | None = None


def bind(host: str, port: int) -> socket.socket:
    """A listening socket; raises ``ServiceStartError`` where the address is taken or not ours."""
    try:
        family, _, _, _, address = socket.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        return socket.create_server(address, family=family, backlog=2048)
    except OSError as error:
        raise ServiceStartError(
            f"Cannot listen on {host} port {port}: {error.strerror}. Choose another --port "
            "(0 takes a free one)."
        ) from error


def http_address(listener: socket.socket) -> str:
    """The ``http://host:port`` under which ``listener`` is reached from this machine."""
    host, port = listener.getsockname()[:2]
    # A socket bound to every address is reached by the loopback one.
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # noqa: S104 - compared, not bound
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


class ServiceStopped(OndeletteError):
    """The service was asked to stop; it is stopped on leaving its context."""


class StopRequest:
    """Ctrl-C, SIGTERM and SIGHUP as a wish that is remembered until somebody looks.

    An exception thrown by the signal itself could hit between the start of a process and the note of it,
    and leave that process behind.
    """

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._remember)

    def _remember(self, number: int, frame: object) -> None:
        self.asked = True


class EmbeddedService:
    """A running service, to be used as a context manager.

    The listening socket is opened here and inherited by the API process, so that a port in use is known at
    once and clients wait, instead of being refused, while the API is started again. Entering raises
    ``ServiceStartError``, and ``ServiceStopped`` once ``stop`` is asked for; whatever was started by then is
    stopped.
    """

    def __init__(
        self, options: ServiceOptions, say: Callable[[str], None], stop: StopRequest | None = None
    ) -> None:
        self._options = options
        self._say = say
        self._stop = stop
        self._undo = contextlib.ExitStack()
        self._supervisor: Supervisor
        self.url: str

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as undo:
            self._start(undo)
            self._undo = undo.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._say("stopping")
        self._undo.close()

    def _start(self, undo: contextlib.ExitStack) -> None:
        options = self._options
        listener = undo.enter_context(bind(options.host, options.port))
        self.url = http_address(listener)
        if options.broker is None:
            address = self._start_broker(undo)
        else:
            address = options.broker
            self._supervisor = Supervisor(self._say, options.output)
            undo.callback(self._supervisor.stop)
            self._say(f"broker   {_without_password(address)}")
        environment = {BROKER_VARIABLE: address}
        if options.keys_needed:
            _check_keys(address)
            environment["ONDELETTE_REQUIRE_KEYS"] = "1"
        concurrency = [] if options.workers is None else ["--concurrency", str(options.workers)]
        worker = ondelette("worker", *concurrency)
        grace = WorkerSettings().shutdown_seconds + WORKER_MARGIN
        self._supervisor.start(ChildSpec("worker", worker, grace, environment))
        descriptor = listener.fileno()
        api = ondelette("api", "--fd", str(descriptor))
        self._supervisor.start(ChildSpec("API", api, API_GRACE, environment, (descriptor,)))
        self._wait_until_ready()

    def _start_broker(self, undo: contextlib.ExitStack) -> str:
        """Start the broker of our own and return its address."""
        binary = find_server(self._options.binary)
        data = DataDirectory(self._options.data)
        undo.callback(data.close)
        broker = EmbeddedBroker(binary, data, self._options.fsync)
        undo.callback(broker.remove_socket)
        self._supervisor = Supervisor(self._say, self._options.output, held=(data.lock,))
        undo.callback(self._supervisor.stop)
        self._say(f"broker   {binary} ({binary.path}), data in {data.path}")
        if binary.warning is not None:
            self._say(f"warning: {binary.warning}")
        self._supervisor.start(ChildSpec("broker", broker.command, BROKER_GRACE))
        broker.wait_until_ready(lambda: "broker" in self._ended())
        return broker.url

    def _wait_until_ready(self, seconds: float = 45.0) -> None:
        """Wait until ``/readyz`` says that the broker is reachable and a worker is alive."""
        import httpx

        deadline = time.monotonic() + seconds
        with httpx.Client(base_url=self.url, timeout=5.0, trust_env=False) as client:
            while True:
                for name, code in self._ended().items():
                    raise ServiceStartError(f"{name} ended with code {code} while the service was starting.")
                try:
                    answer = client.get("/readyz")
                except httpx.TransportError as error:
                    reason = str(error)
                else:
                    if answer.is_success:
                        return
                    reason = answer.text
                if time.monotonic() > deadline:
                    raise ServiceStartError(f"The service was not ready after {seconds:g} s: {reason}")
                time.sleep(0.05)

    def _raise_if_asked_to_stop(self) -> None:
        if self._stop is not None and self._stop.asked:
            raise ServiceStopped("stopped")

    def _ended(self) -> dict[str, int]:
        """Exit codes of processes that have ended; raises ``ServiceStopped`` as ``poll`` does."""
        self._raise_if_asked_to_stop()
        return self._supervisor.ended()

    def poll(self) -> None:
        """Look after the processes; to be called several times a second.

        Raises ``ServiceStopped`` once ``stop`` is asked for.
        """
        self._raise_if_asked_to_stop()
        self._supervisor.poll()


def _check_keys(address: str) -> None:
    """Raise ``ServiceStartError`` where keys are needed and there is none."""
    from app.auth import missing_keys
    from app.settings import Settings

    if (reason := missing_keys(Settings(broker=address))) is not None:
        raise ServiceStartError(f"Refusing to start: {reason}.")


def ondelette(*arguments: str) -> list[str]:
    """The command line of one of our own commands, by the interpreter that runs us."""
    return [sys.executable, "-m", "app.cli", *arguments]


def _without_password(address: str) -> str:
    """``address`` as it may be shown."""
    from urllib.parse import urlsplit

    parts = urlsplit(address)
    if parts.password is None:
        return address
    return parts._replace(netloc=parts.netloc.replace(f":{parts.password}@", ":***@")).geturl()
