"""What all commands share: exit codes, how errors are told, and how a result is written."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


class ExitCode(IntEnum):
    """What the shell is told."""

    SUCCESS = 0
    NOT_SOLVED = 1
    BAD_INPUT = 2
    BROKEN = 3


# Answers of the service that blame the question: no such job, erased, too large, mistakes in the document.
BAD_INPUT_STATUS = frozenset({404, 410, 413, 422})
NO_KEY = 401


class CommandGroup(click.Group):
    """The group of all commands: lists them in the order of their making, and tells errors in one line.

    Every error that is raised on purpose becomes lines on stderr and an exit code; anything else is an
    error of our own: it is told with its traceback, which a report of it needs, and ends with 3.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands in the order of their making."""
        return list(self.commands)

    def invoke(self, ctx: click.Context) -> object:
        """Run a command."""
        from redis.exceptions import RedisError

        from solvers.errors import DocumentError, OndeletteError
        from worker.errors import broker_fault

        try:
            return super().invoke(ctx)
        except DocumentError as error:
            refuse_document((fault.pointer, fault.detail) for fault in error.faults)
        except OndeletteError as error:
            _tell_error(error)
        except RedisError as error:
            fail(broker_fault(error), ExitCode.BROKEN)
        except (click.exceptions.Exit, click.Abort, click.ClickException, BrokenPipeError):
            raise
        except Exception:  # noqa: BLE001 - the outermost frame: told in full, with the exit code for it
            import traceback

            traceback.print_exc()
            raise SystemExit(ExitCode.BROKEN) from None


def _tell_error(error: Exception) -> NoReturn:
    """Tell an error that is not a document's, with the exit code of its kind."""
    from app.client_answers import JobFailed, RequestRefused

    if isinstance(error, RequestRefused):
        if error.errors:
            refuse_document((fault["pointer"], fault["detail"]) for fault in error.errors)
        if error.status == NO_KEY:
            fail(f"{error} The commands take it from ONDELETTE_KEY.", ExitCode.NOT_SOLVED)
        fail(str(error), ExitCode.BAD_INPUT if error.status in BAD_INPUT_STATUS else ExitCode.NOT_SOLVED)
    fail(str(error), ExitCode.NOT_SOLVED if isinstance(error, JobFailed) else ExitCode.BROKEN)


def fail(message: str, code: ExitCode) -> NoReturn:
    """End with one message on stderr."""
    click.echo(f"ondelette: {message}", err=True)
    raise SystemExit(code)


def refuse_document(faults: Iterable[tuple[str, str]], code: ExitCode = ExitCode.BAD_INPUT) -> NoReturn:
    """End with one unwrapped line ``/pointer: detail`` for each fault; the whole document is ``/``."""
    for pointer, detail in faults:
        click.echo(one_line(f"{pointer or '/'}: {detail}"), err=True)
    raise SystemExit(code)


def one_line(text: str) -> str:
    """``text`` without anything that breaks a line or commands a terminal (names come from documents)."""
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in text)


def cell(text: str) -> str:
    """``text`` of others as it stands in a table: neither markup nor commands to a terminal."""
    from rich.markup import escape

    return escape(one_line(text))


def write_output(data: bytes, target: Path | None) -> None:
    """Write to a file, or to stdout without one; ends with 3 when it cannot be written."""
    if target is None:
        sys.stdout.buffer.write(data)
        return
    try:
        target.write_bytes(data)
    except OSError as error:
        fail(f"{target}: {error.strerror}", ExitCode.BROKEN)


def to_json(value: object) -> bytes:
    """JSON for programs, in one line: results are long."""
    import json

    return (json.dumps(value, allow_nan=False, ensure_ascii=False) + "\n").encode()


def progress_bar(shown: bool | None) -> Progress:
    """A bar on stderr: on a terminal, or as asked (``shown``)."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True, force_terminal=True if shown else None)
    disable = not console.is_terminal if shown is None else not shown
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[state]}", markup=False),
        TimeElapsedColumn(),
        console=console,
        disable=disable,
        transient=False,
    )


def describe(progress: Mapping[str, Any] | None) -> str:
    """A job's progress in few words."""
    if not progress:
        return ""
    parts = [str(progress["stage"]), f"iteration {progress['iteration']}"]
    if progress.get("objective") is not None:
        parts.append(f"objective {progress['objective']:.6g}")
    if progress.get("infeasibility") is not None:
        parts.append(f"infeasibility {progress['infeasibility']:.1e}")
    return ", ".join(parts)


def tables() -> Console:
    """Where tables for people are printed."""
    from rich.console import Console

    # Into a file or a pipe nothing is to be cut: there is no window to fit.
    return Console(highlight=False, width=None if sys.stdout.isatty() else 200)
