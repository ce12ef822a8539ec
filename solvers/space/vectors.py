"""Vectors of three components that may be floats, arrays or symbols."""

from __future__ import annotations

from typing import Any

Triple = tuple[Any, Any, Any]


def dot(a: Triple, b: Triple) -> Any:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Triple, b: Triple) -> Triple:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def scaled(factor: Any, a: Triple) -> Triple:
    """A vector times a number."""
    return factor * a[0], factor * a[1], factor * a[2]


def added(*vectors: Triple) -> Triple:
    """The sum of vectors."""
    x, y, z = (sum(parts[1:], start=parts[0]) for parts in zip(*vectors, strict=True))
    return x, y, z
