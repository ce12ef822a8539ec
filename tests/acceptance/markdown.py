"""Reads a page of the documentation as its reader does: runs its examples and compares what is printed.

What becomes of a block of code depends on its language:

* ``sh`` runs by ``bash -e`` in a folder of the page, with the commands of this installation. Lines that begin
  with ``make`` are not run, for the tests are one of them; their targets must exist.
* ``python`` runs in one session for the page.
* ``text`` is what the block before it printed: all lines, or with ``...`` in the place of any; numbers to the
  digits that are shown, seven at most. ``json`` after a command that prints JSON is a part of that.
* Other ``json`` and ``yaml`` must be job documents, or parts of one, that are valid.

A block that cannot run here follows a paragraph ``*Not run by the tests: why.*``, which readers see too; its
``ondelette`` commands must have the options that they are given all the same.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import jsonschema_rs
import pytest
import yaml

from app.cli import main
from solvers.spec import check_document, job_schema

ROOT = Path(__file__).parents[2]
PRINTED_ADDRESS = "http://127.0.0.1:8000"

_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_MARK = re.compile(r"\*Not run by the tests: [^*]+\*\s*\Z")
_TARGETS = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
_NUMBER = re.compile(r"-?\d+(?:\.\d*(?:e[-+]?\d+)?|e-\d+)")
_BETWEEN = {"|", "&", "&&", "||", ";"}
_CHANGING = re.compile(r"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}|\d{4}-\d\d-\d\dT[\d:.]+Z")
"""Ids and times, which differ from one run to the next."""


@dataclass(frozen=True)
class Block:
    """A block of code: its language, its text, the line of the page, and whether it is marked as not run."""

    language: str
    text: str
    line: int
    marked: bool


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page in order."""
    text = page.read_text()
    return [
        Block(
            found[1],
            found[2],
            text.count("\n", 0, found.start()) + 1,
            _MARK.search(text, 0, found.start()) is not None,
        )
        for found in _BLOCK.finditer(text)
    ]


@dataclass
class Reader:
    """Someone who follows a page in a folder of his own, with a service at ``url`` and a broker besides."""

    folder: Path
    url: str
    broker: str
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "page"})
    said: str | None = None
    """What the last block printed; None if there was none, or it was not run."""

    def __post_init__(self) -> None:
        (self.folder / ".venv").symlink_to(sys.prefix)
        (self.folder / ".curlrc").write_text("fail-with-body\n")

    def follow(self, block: Block) -> None:
        """Do what a block says; raises AssertionError or the example's own error where it is not true."""
        if block.language == "text":
            if self.said is not None and not block.marked:
                assert_printed(self.said, block.text)
            return
        if block.language in ("json", "yaml"):
            parsed = parsed_part(block)
            if not (block.language == "json" and self._said_of(parsed)):
                assert_valid(parsed)
            return
        if block.marked:
            self.said = None
            if block.language == "sh":
                assert_known_commands(block.text)
            return
        assert block.language in ("sh", "python"), f"what is to become of a block of {block.language}?"
        self.said = self._run(block.text) if block.language == "sh" else self._exec(block.text)

    def _run(self, text: str) -> str:
        lines = text.replace(PRINTED_ADDRESS, self.url).splitlines()
        for line in lines:
            if line.startswith("make "):
                assert line.split()[1] in _TARGETS, f"no target of the Makefile: {line}"
        script = "\n".join(line for line in lines if not line.startswith("make "))
        environment = {
            **os.environ,
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "ONDELETTE_SERVER": self.url,
            "ONDELETTE_BROKER": self.broker,
            "CURL_HOME": str(self.folder),
        }
        run = subprocess.run(
            ["bash", "-ec", script],
            cwd=self.folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            timeout=60,
        )
        assert run.returncode == 0, run.stdout
        return run.stdout

    def _exec(self, text: str) -> str:
        code = compile(text.replace(PRINTED_ADDRESS, self.url), "page", "exec")
        with contextlib.chdir(self.folder), contextlib.redirect_stdout(io.StringIO()) as out:
            exec(code, self.names)
        return out.getvalue()

    def _said_of(self, printed: Any) -> bool:
        """Tell whether this is a part of the JSON that was printed last."""
        try:
            said = json.loads(_CHANGING.sub("IT", self.said or ""))
        except ValueError:
            return False
        return contains(said, json.loads(_CHANGING.sub("IT", json.dumps(printed))))

    def close(self) -> None:
        """Close what the page opened and did not close, such as its client."""
        for thing in self.names.values():
            if hasattr(thing, "close") and not isinstance(thing, type):
                thing.close()


def contains(said: Any, printed: Any) -> bool:
    """Tell whether ``printed`` is ``said``, or without some of its keys."""
    if isinstance(said, dict) and isinstance(printed, dict):
        return all(key in said and contains(said[key], value) for key, value in printed.items())
    return bool(said == printed)


def assert_printed(said: str, printed: str) -> None:
    """Assert that what was said is what is printed, to its digits; a line ``...`` stands for any lines."""
    lines = [line for line in map(_words, said.splitlines()) if line]
    skipping = False
    for line in filter(None, map(_words, printed.splitlines())):
        if line == "...":
            skipping = True
            continue
        while skipping and lines and not _same(lines[0], line):
            del lines[0]
        assert lines, f"not printed: {line}\n{said}"
        assert _same(lines[0], line), f"printed: {lines[0]}\nin the page: {line}\n{said}"
        del lines[0]
        skipping = False
    assert skipping or not lines, f"not in the page: {lines[0]}"


def _words(line: str) -> str:
    return " ".join(line.split())


def _same(said: str, printed: str) -> bool:
    if _NUMBER.sub("#", _CHANGING.sub("IT", said)) != _NUMBER.sub("#", _CHANGING.sub("IT", printed)):
        return False
    return all(
        float(found) == pytest.approx(float(shown), rel=1e-6, abs=10.0 ** -len(shown.partition(".")[2]))
        for found, shown in zip(
            _NUMBER.findall(_CHANGING.sub("IT", said)),
            _NUMBER.findall(_CHANGING.sub("IT", printed)),
            strict=True,
        )
    )


def parsed_part(block: Block) -> Any:
    """Return a document or a part of one, which may be written without its outer braces."""
    if block.language == "yaml":
        return yaml.safe_load(block.text)
    text = block.text.strip()
    return json.loads(text if text[0] in "{[" else "{" + text + "}")


def assert_valid(part: Any) -> None:
    """Assert that this is a job document without mistakes, or that its keys are those of some part of one."""
    if "problem" in part and "model" in part["problem"]:
        check_document(part)
        return
    schema = job_schema()
    places = [schema, *schema["$defs"].values()]
    for place in places:
        keys = place.get("properties", {})
        if set(part) <= set(keys):
            partial = {"$defs": schema["$defs"], "type": "object", "properties": keys}
            if jsonschema_rs.is_valid(partial, part):
                return
    raise AssertionError(f"no part of a document is like {json.dumps(part)}")


def assert_known_commands(script: str) -> None:
    """Assert that every ``ondelette`` command of a script exists and has the options that it is given."""
    for line in script.replace("\\\n", " ").splitlines():
        for words in _ours(shlex.split(line, comments=True)):
            command, context = main, click.Context(main, info_name="ondelette")
            while isinstance(command, click.Group):
                name, *words = words
                command = command.commands[name]
                context = click.Context(command, parent=context, info_name=name)
            command.make_parser(context).parse_args(words)


def _ours(words: list[str]) -> Iterator[list[str]]:
    """Yield what follows ``ondelette``, where it begins a command, up to the end of that."""
    for place, word in enumerate(words):
        if word == "ondelette" and (place == 0 or words[place - 1] in _BETWEEN):
            rest = words[place + 1 :]
            ends = [index for index, other in enumerate(rest) if other in {*_BETWEEN, ">"}]
            yield rest[: min(ends, default=len(rest))]
