"""The ``coefficients`` of a result: the numbers behind the curves of a trajectory, and the way back.

One pair of functions a basis; ``decode(encode(...))`` gives the same curves, so that a stored result can be
sampled anywhere, exactly, without the problem. A basis on a mesh that is not uniform says which wavelets are
active, or where its knots are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.bases.graded import GradedKnots, GradedWavelets
from solvers.bases.legendre import gauss_support, legendre_gauss
from solvers.bases.spline_wavelet import SplineWaveletBasis
from solvers.curves import (
    Curve,
    DerivativeCurve,
    HermiteCurve,
    LagrangeCurve,
    LinearCurve,
    QuadraticCurve,
    SplineCurve,
)

Vector = NDArray[np.float64]
Curves = Mapping[str, Curve]
Lists = dict[str, list[float]]

SPLINE_WAVELET = "cubic_spline_wavelet"
LAGRANGE = "gauss_lagrange"
HERMITE = "cubic_hermite"


@dataclass(frozen=True)
class Decoded:
    """What coefficients stand for; ``breakpoints`` and ``nodes`` as in a trajectory."""

    states: dict[str, Curve]
    controls: dict[str, Curve]
    interpolation: str
    breakpoints: Vector
    nodes: Vector


def encode(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """The ``coefficients`` of a result."""
    return _CODECS[basis["name"]][0](basis, states, controls)


def decode(coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float) -> Decoded:
    """The curves of stored coefficients, over tau in [0, 1].

    ``node_controls`` are the controls at the nodes of the same result, ``duration`` is tf - t0.
    Raises KeyError for a basis that this version does not know.
    """
    return _CODECS[coefficients["basis"]["name"]][1](coefficients, node_controls, duration)


def _encode_spline_wavelet(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """Coefficients level by level; those of a control represent its nodal values, for the picture."""
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
        },
    }


def _decode_spline_wavelet(
    coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float
) -> Decoded:
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
    return Decoded(
        states,
        {name: LinearCurve(points, np.asarray(values, float)) for name, values in node_controls.items()},
        "linear",
        np.union1d(points, space.knots),
        points,
    )


def _wavelets(basis: Mapping[str, Any]) -> SplineWaveletBasis | GradedWavelets:
    """All wavelets below level J, or those that ``active`` lists, by level."""
    if "active" in basis:
        return GradedWavelets(GradedKnots.from_active(basis["L"], basis["active"]))
    return SplineWaveletBasis(basis["L"], basis["J"])


def gauss_nodes(breaks: Vector, counts: Sequence[int]) -> Vector:
    """The starts and Gauss nodes of the segments between ``breaks``, and the end of the last one."""
    pieces = [
        start + width * (gauss_support(count) + 1.0) / 2.0
        for start, width, count in zip(breaks[:-1], np.diff(breaks), counts, strict=True)
    ]
    return np.concatenate([*pieces, [1.0]])


def _encode_lagrange(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """Values at the support points, segment by segment: its start and Gauss nodes; the nodes for controls."""
    return {
        "basis": dict(basis),
        "states": _segment_values(states),
        "controls": _segment_values(controls),
    }


def _decode_lagrange(
    coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float
) -> Decoded:
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


def _encode_hermite(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """Values at the knots, then slopes with respect to tau; controls at knots and middles, alternating."""
    return {
        "basis": {**basis, "order": ["values", "slopes"]},
        "states": {
            name: [*curve.values.tolist(), *curve.slopes.tolist()]
            for name, curve in states.items()
            if isinstance(curve, HermiteCurve)
        },
        "controls": {
            name: curve.values.tolist()
            for name, curve in controls.items()
            if isinstance(curve, QuadraticCurve)
        },
    }


def _decode_hermite(
    coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float
) -> Decoded:
    basis = coefficients["basis"]
    knots = np.array(basis.get("knots", np.linspace(0.0, 1.0, basis["intervals"] + 1)), np.float64)
    nodes = np.insert(knots, np.arange(1, knots.size), (knots[1:] + knots[:-1]) / 2.0)
    return Decoded(
        {
            name: HermiteCurve(knots, *np.reshape(values, (2, -1)))
            for name, values in coefficients["states"].items()
        },
        {
            name: QuadraticCurve(knots, np.asarray(values, float))
            for name, values in coefficients["controls"].items()
        },
        "quadratic",
        knots,
        nodes,
    )


def _segment_values(curves: Curves) -> Lists:
    return {
        name: np.concatenate(curve.values).tolist()
        for name, curve in curves.items()
        if isinstance(curve, LagrangeCurve)
    }


_Encoder = Callable[[Mapping[str, Any], Curves, Curves], dict[str, Any]]
_Decoder = Callable[[Mapping[str, Any], Mapping[str, Any], float], Decoded]
_CODECS: dict[str, tuple[_Encoder, _Decoder]] = {
    SPLINE_WAVELET: (_encode_spline_wavelet, _decode_spline_wavelet),
    LAGRANGE: (_encode_lagrange, _decode_lagrange),
    HERMITE: (_encode_hermite, _decode_hermite),
}
