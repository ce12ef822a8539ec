"""The reference of the command line: what each command says of itself."""

from __future__ import annotations

from collections.abc import Iterator

import click

from app.cli import main


def _commands(command: click.Command, parent: click.Context | None, name: str) -> Iterator[tuple[str, str]]:
    """Yield name and help of a command and of all below it."""
    context = click.Context(command, parent=parent, info_name=name, max_content_width=100, terminal_width=100)
    yield context.command_path, command.get_help(context)
    if isinstance(command, click.Group):
        for sub in command.list_commands(context):
            yield from _commands(command.commands[sub], context, sub)


def render() -> str:
    """Return the whole reference as Markdown."""
    return "\n\n".join(
        f"## `{name}`\n\n```text\n{text}\n```" for name, text in _commands(main, None, "ondelette")
    )
