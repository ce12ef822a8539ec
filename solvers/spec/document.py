"""Strict JSON: what a document is before anybody asks what it means."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable
from typing import Any

from solvers.errors import DocumentError, Fault, FaultType
from solvers.expressions import quoted
from solvers.spec.faults import Flaws, kind_of
from solvers.spec.values import is_finite

MAX_NESTING = 64
_LONGEST_INTEGER = 310  # characters of the largest double, sign included
_TOO_DEEP = f"limit: nested deeper than {MAX_NESTING} levels"


class _Repeated(dict[str, Any]):
    """An object in which a key stood more than once; lives only until `walk` has found it."""

    keys_twice: list[str]


def parse_document(raw: bytes | str) -> object:
    """Return the document that a JSON text stands for.

    Refuses what Python's reader lets pass or fails on: duplicate keys, NaN, Infinity, numbers beyond the
    range of a double, nesting deeper than 64 levels, text that is not UTF-8.

    Raises DocumentError, with a pointer for each place, or with line and column if the text is not JSON.
    """
    try:
        text = raw if isinstance(raw, str) else raw.decode("utf-8-sig")
        document = json.loads(text, object_pairs_hook=_object, parse_int=_integer)
    except UnicodeDecodeError as error:
        raise _whole(f"the document is not UTF-8: byte {error.start + 1} cannot be read") from None
    except json.JSONDecodeError as error:
        raise _whole(f"not JSON: {error.msg} at line {error.lineno}, column {error.colno}") from None
    except RecursionError:
        raise _whole(_TOO_DEEP, "limit") from None
    flaws = Flaws()
    walk(document, flaws)
    if flaws.found:
        raise DocumentError(flaws.faults())
    return document


def _whole(detail: str, type: FaultType = "invalid") -> DocumentError:
    return DocumentError([Fault("", detail, type)])


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    plain = dict(pairs)
    if len(plain) == len(pairs):
        return plain
    repeated = _Repeated(plain)
    repeated.keys_twice = [key for key, times in Counter(key for key, _ in pairs).items() if times > 1]
    return repeated


def _integer(digits: str) -> float:
    return int(digits) if len(digits) <= _LONGEST_INTEGER else math.inf


def walk(document: object, flaws: Flaws) -> None:
    """Note every place of ``document`` that is not a JSON value with finite numbers, at most 64 levels deep.

    Documents need not come from JSON text: YAML and Python can hold dates, NaN and keys that are not text.
    """
    waiting: list[tuple[Any, tuple[str | int, ...]]] = [(document, ())]
    while waiting:
        value, path = waiting.pop()
        if isinstance(value, dict):
            for key in value.keys_twice if isinstance(value, _Repeated) else ():
                flaws.add(f"the key {quoted(key)} stands more than once", *path, key)
            for key in value:
                fault = "a key must be text, not " + kind_of(key) if type(key) is not str else _flaw(key)
                if fault:
                    flaws.add(fault, *path, str(key))
        elif not isinstance(value, list):
            fault = _flaw(value)
            if fault:
                flaws.add(fault, *path)
            continue
        if len(path) >= MAX_NESTING:
            flaws.add(_TOO_DEEP, *path, type="limit")
            continue
        children: Iterable[tuple[str | int, Any]]
        if isinstance(value, dict):
            children = value.items()
        elif _all_finite(value):
            continue
        else:
            children = enumerate(value)
        later = [
            (child, (*path, place))
            for place, child in children
            if isinstance(child, dict | list) or _flaw(child)
        ]
        waiting.extend(reversed(later))  # the last is taken first: places come in the order of the document


def _all_finite(items: list[Any]) -> bool:
    """Tell whether a list holds finite numbers only: the quick way through long tables."""
    try:
        return all(map(math.isfinite, items))
    except (TypeError, OverflowError):
        return False


def _flaw(scalar: object) -> str | None:
    """Return what is wrong with a value that is neither object nor list."""
    if isinstance(scalar, str):
        if scalar.isascii():
            return None
        try:
            scalar.encode()
        except UnicodeEncodeError:
            return "the text holds half of a surrogate pair, which is no character"
        return None
    if scalar is None or isinstance(scalar, bool):
        return None
    if isinstance(scalar, int | float):
        return None if is_finite(scalar) else "a number must be finite (about 1.8e308 is the largest)"
    return f"{kind_of(scalar)} is not a JSON value"
