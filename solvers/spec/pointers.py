"""JSON pointers (RFC 6901) as places that can be set: how a sweep changes a document."""

from __future__ import annotations

import re
from typing import Any

_ESCAPE = re.compile(r"~(?![01])")
_INDEX = re.compile(r"0|[1-9]\d{0,8}")


def parse_pointer(text: str) -> tuple[str, ...]:
    """Return the keys of a pointer, from the root of the document on.

    Raises ValueError, with what is wrong, for what is no pointer or names the whole document.
    """
    if not text.startswith("/"):
        raise ValueError("a JSON pointer to a value starts with '/'")
    if _ESCAPE.search(text):
        raise ValueError("in a JSON pointer '~' is written '~0' and '/' inside a key '~1'")
    return tuple(part.replace("~1", "/").replace("~0", "~") for part in text[1:].split("/"))


def with_value(document: Any, keys: tuple[str, ...], value: Any) -> Any:
    """Return ``document`` with ``value`` at the place of ``keys``; what does not change is shared.

    An object that is missing on the way is made. Raises ValueError, with what is wrong, for a place inside
    a list that is not there, and inside a value that is neither object nor list.
    """
    if not keys:
        return value
    key, *rest = keys
    if isinstance(document, dict):
        return {**document, key: with_value(document.get(key, {}), tuple(rest), value)}
    if isinstance(document, list):
        if not _INDEX.fullmatch(key) or int(key) >= len(document):
            raise ValueError(
                f"there is a list of {len(document)} on the way, which has no place {key[:60]!r}"
            )
        index = int(key)
        return [
            *document[:index],
            with_value(document[index], tuple(rest), value),
            *document[index + 1 :],
        ]
    raise ValueError("there is a value on the way that is neither an object nor a list")
