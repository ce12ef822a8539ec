"""The ``coefficients`` of a result: the numbers behind the curves of a trajectory, and the way back.

One pair of functions a basis; ``decode(encode(...))`` gives the same curves, so that a stored result can be
sampled anywhere, exactly, without the problem. A basis on a mesh that is not uniform says which wavelets are
active, or where its knots are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.bases.daubechies import DaubechiesBasis
from solvers.bases.graded import GradedKnots, GradedWavelets
from solvers.bases.legendre import gauss_support, legendre_gauss
from solvers.bases.spline_wavelet import SplineWaveletBasis
from solvers.curves import (
    Curve,
    DaubechiesCurve,
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
DAUBECHIES = "daubechies"
FLIGHT = "cubic_hermite_flight"


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
        "states": _cubics(states),
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
    return Decoded(
        _hermite_curves(knots, coefficients["states"]),
        {
            name: QuadraticCurve(knots, np.asarray(values, float))
            for name, values in coefficients["controls"].items()
        },
        "quadratic",
        knots,
        with_middles(knots),
    )


def describe_daubechies(basis: DaubechiesBasis, level: int) -> dict[str, Any]:
    """The ``basis`` of a trajectory with controls in Daubechies' functions, tabulated on ``level``."""
    return {
        "name": DAUBECHIES,
        "wavelet": f"db{basis.order}",
        "boundary": "periodic" if basis.periodic else "interval",
        "scaling_functions": basis.scaling_functions,
        "wavelet_levels": basis.levels,
        "order": list(basis.blocks),
        "level": level,
    }


def _encode_daubechies(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """Controls by their coefficients, block after block; states as those of Hermite's cubics."""
    return {
        "basis": dict(basis),
        "states": _cubics(states),
        "controls": {
            name: curve.coefficients.tolist()
            for name, curve in controls.items()
            if isinstance(curve, DaubechiesCurve)
        },
    }


def _decode_daubechies(
    coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float
) -> Decoded:
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
        _hermite_curves(knots, coefficients["states"]),
        {
            name: DaubechiesCurve(basis, level, np.array(values, np.float64))
            for name, values in coefficients["controls"].items()
        },
        "quadratic",
        knots,
        with_middles(knots),
    )


def _encode_flight(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """States as those of Hermite's cubics; of controls, which may jump, both ends of each piece in turn."""
    return {
        "basis": {**basis, "order": ["values", "slopes"]},
        "states": _cubics(states),
        "controls": _segment_values(controls),
    }


def _decode_flight(
    coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float
) -> Decoded:
    knots = np.array(coefficients["basis"]["knots"], np.float64)
    controls: dict[str, Curve] = {
        name: linear_pieces(knots, np.reshape(values, (-1, 2)))
        for name, values in coefficients["controls"].items()
    }
    return Decoded(_hermite_curves(knots, coefficients["states"]), controls, "linear", knots, knots)


def linear_pieces(knots: Vector, ends: Vector) -> LagrangeCurve:
    """A straight line between each two knots; ``ends`` (pieces, 2) are its values there."""
    return LagrangeCurve(knots, (np.array([-1.0, 1.0]),) * (knots.size - 1), tuple(ends))


def _cubics(states: Curves) -> Lists:
    return {
        name: [*curve.values.tolist(), *curve.slopes.tolist()]
        for name, curve in states.items()
        if isinstance(curve, HermiteCurve)
    }


def _hermite_curves(knots: Vector, lists: Mapping[str, list[float]]) -> dict[str, Curve]:
    return {name: HermiteCurve(knots, *np.reshape(values, (2, -1))) for name, values in lists.items()}


def with_middles(knots: Vector) -> Vector:
    """The knots and the middles between them."""
    return np.insert(knots, np.arange(1, knots.size), (knots[1:] + knots[:-1]) / 2.0)


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
    DAUBECHIES: (_encode_daubechies, _decode_daubechies),
    FLIGHT: (_encode_flight, _decode_flight),
}
