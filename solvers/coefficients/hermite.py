"""Values and slopes of cubics at their knots; controls are quadratic between the knots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from solvers.coefficients.codec import Curves, Decoded, cubics, hermite_curves, with_middles
from solvers.curves import QuadraticCurve

NAME = "cubic_hermite"


def encode(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """Values at the knots, then slopes with respect to tau; controls at knots and middles, alternating."""
    return {
        "basis": {**basis, "order": ["values", "slopes"]},
        "states": cubics(states),
        "controls": {
            name: curve.values.tolist()
            for name, curve in controls.items()
            if isinstance(curve, QuadraticCurve)
        },
    }


def decode(coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float) -> Decoded:
    """Return the curves; knots are equally spaced where none are given."""
    basis = coefficients["basis"]
    knots = np.array(basis.get("knots", np.linspace(0.0, 1.0, basis["intervals"] + 1)), np.float64)
    return Decoded(
        hermite_curves(knots, coefficients["states"]),
        {
            name: QuadraticCurve(knots, np.asarray(values, float))
            for name, values in coefficients["controls"].items()
        },
        "quadratic",
        knots,
        with_middles(knots),
    )
