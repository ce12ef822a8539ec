"""What a basis knows of its coefficients: a name, and the way from curves to numbers and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.curves import Curve, HermiteCurve, LagrangeCurve

Vector = NDArray[np.float64]
Curves = Mapping[str, Curve]
Lists = dict[str, list[float]]


@dataclass(frozen=True)
class Decoded:
    """What coefficients stand for; ``breakpoints`` and ``nodes`` as in a trajectory."""

    states: dict[str, Curve]
    controls: dict[str, Curve]
    interpolation: str
    breakpoints: Vector
    nodes: Vector


class Codec(Protocol):
    """A module of a basis."""

    NAME: str

    def encode(self, basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
        """Return the ``coefficients`` of a result."""
        ...

    def decode(
        self, coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float
    ) -> Decoded:
        """Return the curves of stored coefficients."""
        ...


def cubics(states: Curves) -> Lists:
    """The values of Hermite's cubics at their knots, then the slopes there with respect to tau."""
    return {
        name: [*curve.values.tolist(), *curve.slopes.tolist()]
        for name, curve in states.items()
        if isinstance(curve, HermiteCurve)
    }


def hermite_curves(knots: Vector, lists: Mapping[str, list[float]]) -> dict[str, Curve]:
    """The way back from :func:`cubics`."""
    return {name: HermiteCurve(knots, *np.reshape(values, (2, -1))) for name, values in lists.items()}


def with_middles(knots: Vector) -> Vector:
    """The knots and the middles between them."""
    return np.insert(knots, np.arange(1, knots.size), (knots[1:] + knots[:-1]) / 2.0)


def segment_values(curves: Curves) -> Lists:
    """The values of polynomials at their support points, segment after segment."""
    return {
        name: np.concatenate(curve.values).tolist()
        for name, curve in curves.items()
        if isinstance(curve, LagrangeCurve)
    }
