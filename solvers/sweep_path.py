"""The points of a sweep as places in space, and a path through them on which neighbours are near."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def coordinates(axes: Sequence[Sequence[Any]], *, logarithmic: Sequence[bool]) -> list[Vector]:
    """Return where each value of each axis stands in [0, 1].

    Numbers stand by their size, or by its logarithm where ``logarithmic``; values that are no numbers stand
    in the order in which they are given.
    """
    return [_placed(axis, log) for axis, log in zip(axes, logarithmic, strict=True)]


def _placed(axis: Sequence[Any], logarithmic: bool) -> Vector:
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in axis):
        places = np.array(axis, np.float64)
        if logarithmic:
            places = np.log(np.abs(places))
    else:
        places = np.arange(len(axis), dtype=np.float64)
    low, high = float(places.min()), float(places.max())
    return np.zeros(len(axis)) if high == low else (places - low) / (high - low)


def path_through_grid(places: Sequence[Vector]) -> list[int]:
    """Order the points of a product of axes, numbered with the last axis fastest, so that one step is short.

    The path goes to and fro (boustrophedon): from point to point a single axis moves on by one value.
    """
    path = [0]
    for axis in places:
        forward = np.argsort(axis, kind="stable").tolist()
        path = [
            before * len(forward) + value
            for number, before in enumerate(path)
            for value in (forward if number % 2 == 0 else reversed(forward))
        ]
    return path


def path_through_points(points: Vector) -> list[int]:
    """Order points (N, axes): from the one nearest to the origin always to the nearest that is left."""
    left = np.arange(len(points))
    here = int(np.argmin(np.abs(points).sum(axis=1)))
    path: list[int] = []
    while True:
        path.append(int(left[here]))
        place = points[left[here]]
        left = np.delete(left, here)
        if not left.size:
            return path
        here = int(np.argmin(((points[left] - place) ** 2).sum(axis=1)))
