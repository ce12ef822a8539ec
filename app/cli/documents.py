"""Reads a job document from a file: JSON, or YAML written by hand."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.common import ExitCode, fail

if TYPE_CHECKING:
    import yaml

    from solvers.errors import DocumentError

YAML_SUFFIXES = frozenset({".yaml", ".yml"})


def read_document(source: str) -> object:
    """Read the document in file ``source`` (``-`` for standard input).

    JSON is told from YAML by the suffix, and where that says nothing by the first character. Raises
    ``DocumentError`` for text that is neither; ends with 2 when there is nothing to read.
    """
    raw = _read(source)
    suffix = Path(source).suffix.lower()
    if suffix in YAML_SUFFIXES or (suffix != ".json" and not raw.lstrip().startswith(b"{")):
        return _from_yaml(raw)
    from solvers.spec import parse_document

    return parse_document(raw)


def _read(source: str) -> bytes:
    """The bytes of a document; what the service would refuse for its length is refused without reading on."""
    from app.settings import Settings

    longest: int = Settings.model_fields["body_bytes"].default
    try:
        if source == "-":
            raw = sys.stdin.buffer.read(longest + 1)
        else:
            with Path(source).open("rb") as file:
                raw = file.read(longest + 1)
    except OSError as error:
        fail(f"{source}: {error.strerror}", ExitCode.BAD_INPUT)
    if len(raw) > longest:
        from solvers.errors import DocumentError, Fault

        raise DocumentError([Fault("", f"the document is longer than {longest:,} bytes", "limit")])
    return raw


def _from_yaml(raw: bytes) -> object:
    """Read YAML as the same tree that JSON would give."""
    import json

    import yaml

    from solvers.errors import DocumentError, Fault
    from solvers.spec import parse_document

    try:
        tree = yaml.load(raw, Loader=_loader())  # noqa: S506 - a SafeLoader with fewer types
    except yaml.MarkedYAMLError as error:
        raise _refused(error.problem_mark, error.problem or str(error.context)) from error
    except yaml.YAMLError as error:
        raise _refused(None, f"this is no YAML document: {error}") from error
    except RecursionError as error:
        raise DocumentError([Fault("", "the document is nested too deeply", "limit")]) from error
    # What JSON cannot say (NaN, too deep a nesting) is refused in one place for both.
    return parse_document(json.dumps(tree).encode())


def _refused(mark: Any, detail: str) -> DocumentError:
    from solvers.errors import DocumentError, Fault

    place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark is not None else ""
    return DocumentError([Fault("", place + detail)])


def _loader() -> type[yaml.SafeLoader]:
    """A loader of YAML that knows what JSON knows: texts, numbers, true, false, null, lists, mappings.

    YAML 1.1 reads ``no`` as false, ``1e-8`` as a text and ``12:30`` as 750; here plain scalars follow JSON
    (the core schema of YAML 1.2). Duplicate keys, keys that are no texts, and aliases are refused.
    """
    import re

    import yaml

    class Loader(yaml.SafeLoader):
        def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
            if self.check_event(yaml.AliasEvent):
                mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
                raise _refused(mark, "aliases are not supported; write the value out")
            return super().compose_node(parent, index)

        def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
            seen: set[str] = set()
            for key, _ in node.value:
                if key.tag != "tag:yaml.org,2002:str":
                    raise _refused(key.start_mark, "a key must be a text; put it into quotes")
                if key.value in seen:
                    raise _refused(key.start_mark, f"duplicate key {key.value!r}")
                seen.add(key.value)
            return super().construct_mapping(node, deep)

    # The resolvers of YAML 1.1 belong to the base class; ours start from none.
    Loader.yaml_implicit_resolvers = {}
    number = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
    for tag, pattern, first in (
        ("bool", r"true|false", "tf"),
        ("null", r"null|~|", ["n", "~", ""]),
        ("int", r"[-+]?\d+", "-+0123456789"),
        ("float", rf"{number}|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)", "-+0123456789."),
    ):
        Loader.add_implicit_resolver(f"tag:yaml.org,2002:{tag}", re.compile(rf"^(?:{pattern})$"), list(first))
    return Loader
