"""Strict JSON: what a document is before anybody asks what it means."""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from typing import Any

from solvers.errors import DocumentError, Fault, FaultType
from solvers.expressions import quoted
from solvers.spec.faults import Flaws, Path, kind_of
from solvers.spec.values import is_finite

MAX_NESTING = 64
_LARGEST = sys.float_info.max
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
        if not isinstance(value, dict | list):
            if fault := _flaw(value):
                flaws.add(fault, *path)
            continue
        if isinstance(value, dict):
            _check_keys(value, path, flaws)
        if len(path) >= MAX_NESTING:
            flaws.add(_TOO_DEEP, *path, type="limit")
            continue
        later = []
        for place, child in value.items() if isinstance(value, dict) else enumerate(value):
            kind = type(child)
            # Nearly every value is one of these; what is not is looked at on its own.
            if kind is str:
                plain = child.isascii()
            elif kind is int or kind is float:
                plain = -_LARGEST <= child <= _LARGEST
            else:
                plain = child is None or kind is bool
            if not plain:
                later.append((child, (*path, place)))
        waiting.extend(reversed(later))  # the last is taken first: places come in the order of the document


def _check_keys(value: dict[Any, Any], path: Path, flaws: Flaws) -> None:
    for key in value.keys_twice if isinstance(value, _Repeated) else ():
        flaws.add(f"the key {quoted(key)} stands more than once", *path, key)
    for key in value:
        if type(key) is str and key.isascii():
            continue
        if fault := _flaw(key) if isinstance(key, str) else f"a key must be text, not {kind_of(key)}":
            flaws.add(fault, *path, str(key))


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
