"""Controls in Daubechies' functions, block after block; states as Hermite's cubics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from solvers.bases.daubechies import DaubechiesBasis
from solvers.coefficients.codec import Curves, Decoded, cubics, hermite_curves, with_middles
from solvers.curves import DaubechiesCurve

NAME = "daubechies"


def describe(basis: DaubechiesBasis, level: int) -> dict[str, Any]:
    """The ``basis`` of a trajectory with controls in Daubechies' functions, tabulated on ``level``."""
    return {
        "name": NAME,
        "wavelet": f"db{basis.order}",
        "boundary": "periodic" if basis.periodic else "interval",
        "scaling_functions": basis.scaling_functions,
        "wavelet_levels": basis.levels,
        "order": list(basis.blocks),
        "level": level,
    }


def encode(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """Controls by their coefficients, block after block; states as those of Hermite's cubics."""
    return {
        "basis": dict(basis),
        "states": cubics(states),
        "controls": {
            name: curve.coefficients.tolist()
            for name, curve in controls.items()
            if isinstance(curve, DaubechiesCurve)
        },
    }


def decode(coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float) -> Decoded:
    """Return the curves; a control is tabulated on the level of the basis."""
    described = coefficients["basis"]
    basis = DaubechiesBasis(
        int(described["wavelet"].removeprefix("db")),
        described["scaling_functions"],
        described["wavelet_levels"],
        described["boundary"] == "periodic",
    )
    level = described["level"]
    knots = basis.points(level)
    return Decoded(
        hermite_curves(knots, coefficients["states"]),
        {
            name: DaubechiesCurve(basis, level, np.array(values, np.float64))
            for name, values in coefficients["controls"].items()
        },
        "quadratic",
        knots,
        with_middles(knots),
    )
