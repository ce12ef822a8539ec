"""``ondelette bench``: the benchmark scripts of the project."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import click

from app.cli.common import ExitCode, fail

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@click.command()
@click.argument("names", nargs=-1)
def bench(names: tuple[str, ...]) -> None:
    """Print the benchmark tables: all, or those of the scripts NAMES."""
    scripts = {path.stem: path for path in sorted(FOLDER.glob("*.py")) if not path.stem.startswith("_")}
    if not scripts:
        fail(f"there are no benchmarks in {FOLDER}: run this from a checkout", ExitCode.BAD_INPUT)
    for name in names or scripts:
        if name not in scripts:
            fail(f"no benchmark {name!r}; there are {', '.join(scripts)}.", ExitCode.BAD_INPUT)
    # Some share with the tests how a service is run.
    sys.path.insert(0, str(FOLDER.parent))
    # Scripts take arguments of their own; what is said to this command is not among them.
    del sys.argv[1:]
    for name in names or scripts:
        runpy.run_path(str(scripts[name]), run_name="__main__")
