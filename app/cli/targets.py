"""Files that commands write, checked before the work is done rather than after."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import click

from app.cli.common import write_output

PLOT_SUFFIXES = (".svg", ".png")


def writable(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
    """Option callback: a usage error unless the file can be written."""
    if path is None:
        return None
    if path.is_dir():
        raise click.BadParameter(f"{path} is a folder")
    if not path.parent.is_dir():
        raise click.BadParameter(f"the folder {path.parent} does not exist")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise click.BadParameter(f"{path} cannot be written")
    return path


def picture(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
    """Option callback: as ``writable``, and the suffix tells a kind of picture."""
    if path is not None and path.suffix.lower() not in PLOT_SUFFIXES:
        raise click.BadParameter(f"{path} must end with {' or '.join(PLOT_SUFFIXES)}")
    return writable(ctx, param, path)


output_option = click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    callback=writable,
    help="Write the result here, not to stdout.",
)
plot_option = click.option(
    "--plot",
    type=click.Path(path_type=Path),
    callback=picture,
    help="Draw states and controls here (.svg or .png).",
)


def draw(result: Mapping[str, Any], title: str | None, target: Path) -> None:
    """Draw a result into ``target``."""
    from solvers.output.plot import render

    kind: Literal["png", "svg"] = "png" if target.suffix.lower() == ".png" else "svg"
    write_output(render(result, kind, title or ""), target)
