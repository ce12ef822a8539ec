"""Wavelet coefficients, level by level: all below level J, or on graded knots those that are active."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from solvers.bases.graded import GradedKnots, GradedWavelets
from solvers.bases.spline_wavelet import SplineWaveletBasis
from solvers.coefficients.codec import Curves, Decoded
from solvers.curves import Curve, DerivativeCurve, LinearCurve, SplineCurve

NAME = "cubic_spline_wavelet"


def encode(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """Coefficients level by level; those of a control represent its nodal values, for the picture.

    Rated controls are straight lines: their values at the points stand under ``ramps``.
    """
    wavelets = _wavelets(basis)
    space = wavelets.spline
    splines = {name: curve for name, curve in states.items() if isinstance(curve, SplineCurve)}
    owners = {id(curve): name for name, curve in splines.items()}
    velocities = {
        name: owners[id(curve.curve)] for name, curve in states.items() if isinstance(curve, DerivativeCurve)
    }
    return {
        "basis": {**basis, "order": wavelets.order, "velocities": velocities},
        "states": {
            name: wavelets.from_spline(curve.coefficients).tolist() for name, curve in splines.items()
        },
        "controls": {
            name: wavelets.from_spline(space.interpolate(curve(space.interpolation_points))).tolist()
            for name, curve in controls.items()
            if isinstance(curve, LinearCurve)
        },
        "ramps": {
            name: curve.values.tolist() for name, curve in states.items() if isinstance(curve, LinearCurve)
        },
    }


def decode(coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float) -> Decoded:
    """Return the curves: splines of the states, straight lines of the controls between their nodal values."""
    basis = coefficients["basis"]
    wavelets = _wavelets(basis)
    space = wavelets.spline
    points = space.greville(basis["derivative"])
    states: dict[str, Curve] = {
        name: SplineCurve(space, wavelets.to_spline(values))
        for name, values in coefficients["states"].items()
    }
    for name, owner in basis["velocities"].items():
        states[name] = DerivativeCurve(states[owner], 1.0 / duration)
    controls: dict[str, Curve] = {
        name: LinearCurve(points, np.asarray(values, float)) for name, values in node_controls.items()
    }
    for name in basis.get("ramps", ()):
        states[name] = LinearCurve(points, np.asarray(coefficients["ramps"][name], float))
        controls[f"{name}_dot"] = DerivativeCurve(states[name], 1.0 / duration)
    return Decoded(
        states,
        controls,
        "linear",
        np.union1d(points, space.knots),
        points,
    )


def _wavelets(basis: Mapping[str, Any]) -> SplineWaveletBasis | GradedWavelets:
    """All wavelets below level J, or those that ``active`` lists, by level."""
    if "active" in basis:
        return GradedWavelets(GradedKnots.from_active(basis["L"], basis["active"]))
    return _uniform_wavelets(basis["L"], basis["J"])


# Its transforms are matrices, made once.
_uniform_wavelets = lru_cache(maxsize=8)(SplineWaveletBasis)
