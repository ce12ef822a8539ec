"""A flight from knot to knot: cubics, and controls that may jump at every knot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from solvers.coefficients.codec import Curves, Decoded, Vector, cubics, hermite_curves, segment_values
from solvers.curves import Curve, LagrangeCurve

NAME = "cubic_hermite_flight"


def encode(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """States as those of Hermite's cubics; of controls, which may jump, both ends of each piece in turn."""
    return {
        "basis": {**basis, "order": ["values", "slopes"]},
        "states": cubics(states),
        "controls": segment_values(controls),
    }


def decode(coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float) -> Decoded:
    """Return the curves, a straight line between each two knots for a control."""
    knots = np.array(coefficients["basis"]["knots"], np.float64)
    controls: dict[str, Curve] = {
        name: linear_pieces(knots, np.reshape(values, (-1, 2)))
        for name, values in coefficients["controls"].items()
    }
    return Decoded(hermite_curves(knots, coefficients["states"]), controls, "linear", knots, knots)


def linear_pieces(knots: Vector, ends: Vector) -> LagrangeCurve:
    """A straight line between each two knots; ``ends`` (pieces, 2) are its values there."""
    return LagrangeCurve(knots, (np.array([-1.0, 1.0]),) * (knots.size - 1), tuple(ends))
