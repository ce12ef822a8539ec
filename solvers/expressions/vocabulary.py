"""The words of the expression language: functions, constants and reserved names."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from itertools import islice
from typing import Any

import numpy as np

ARITY: Mapping[str, tuple[int, int | None]] = {
    **dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"), (1, 1)),
    **dict.fromkeys(("exp", "log", "sqrt", "abs", "sign"), (1, 1)),
    "atan2": (2, 2),
    **dict.fromkeys(("min", "max"), (2, None)),
}
"""Smallest and largest number of arguments of each function (``None``: no upper limit)."""

FUNCTIONS = frozenset(ARITY)
"""Names of the functions; ``log`` is the natural logarithm, angles are in rad."""

NUMPY_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
    "min": np.minimum,
    "max": np.maximum,
}
"""Every function over floats and NumPy arrays; ``min`` and ``max`` take two arguments at a time."""

CONSTANTS: Mapping[str, float] = {"pi": math.pi, "deg": math.pi / 180, "rpm": math.pi / 30}
"""Constants: ``deg`` turns degrees into rad, ``rpm`` revolutions per minute into rad/s."""

LOOKUP = "(lookup)"
"""Beside the functions of a backend: what looks a value up in a data table; no document can name it."""

RESERVED = FUNCTIONS | CONSTANTS.keys() | {"t", "t0", "tf"}
"""Names that no state, control or parameter may have."""

_LONGEST_ECHO = 60
_MOST_CANDIDATES = 200


def quoted(word: str) -> str:
    """Return ``word`` in quotes as an error message shows it: printable, and cut if it is long."""
    cut = word if len(word) <= _LONGEST_ECHO else word[:_LONGEST_ECHO] + "..."
    return "'" + "".join(c if c.isprintable() else "?" for c in cut) + "'"


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """Return ``"; did you mean 'k'?"`` for the candidate closest to ``word``, ``""`` if none is close.

    Only the first 200 candidates are looked at, so that hostile input costs no time.
    """
    if len(word) > _LONGEST_ECHO:
        return ""
    pool = list(islice(candidates, _MOST_CANDIDATES))
    folded = {name.lower(): name for name in reversed(pool)}
    close = difflib.get_close_matches(word, pool, n=1, cutoff=0.5)
    best = folded.get(word.lower()) or (close[0] if close else None)
    return f"; did you mean {quoted(best)}?" if best is not None else ""
