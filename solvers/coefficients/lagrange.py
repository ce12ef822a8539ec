"""Values at the support points of polynomials, segment by segment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from solvers.bases.legendre import gauss_support, legendre_gauss
from solvers.coefficients.codec import Curves, Decoded, Vector, segment_values
from solvers.curves import Curve, LagrangeCurve

NAME = "gauss_lagrange"


def gauss_nodes(breaks: Vector, counts: Sequence[int]) -> Vector:
    """The starts and Gauss nodes of the segments between ``breaks``, and the end of the last one."""
    pieces = [
        start + width * (gauss_support(count) + 1.0) / 2.0
        for start, width, count in zip(breaks[:-1], np.diff(breaks), counts, strict=True)
    ]
    return np.concatenate([*pieces, [1.0]])


def encode(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """Values at the support points, segment by segment: its start and Gauss nodes; the nodes for controls."""
    return {
        "basis": dict(basis),
        "states": segment_values(states),
        "controls": segment_values(controls),
    }


def decode(coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float) -> Decoded:
    """Return the curves, a polynomial in each segment."""
    basis = coefficients["basis"]
    breaks, counts = np.array(basis["breaks"], np.float64), basis["nodes"]
    nodes = gauss_nodes(breaks, counts)

    def curves(lists: Mapping[str, list[float]], supports: tuple[Vector, ...]) -> dict[str, Curve]:
        ends = np.cumsum([support.size for support in supports])[:-1]
        return {
            name: LagrangeCurve(breaks, supports, tuple(np.split(np.array(values, np.float64), ends)))
            for name, values in lists.items()
        }

    return Decoded(
        curves(coefficients["states"], tuple(map(gauss_support, counts))),
        curves(coefficients["controls"], tuple(legendre_gauss(count)[0] for count in counts)),
        "polynomial",
        nodes,
        nodes,
    )
