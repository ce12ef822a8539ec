"""The ``coefficients`` of a result: the numbers behind the curves of a trajectory, and the way back.

One module a basis; ``decode(encode(...))`` gives the same curves, so that a stored result can be sampled
anywhere, exactly, without the problem. A basis on a mesh that is not uniform says which wavelets are active,
or where its knots are.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from solvers.coefficients import daubechies, flight, hermite, lagrange, spline_wavelet
from solvers.coefficients.codec import Codec, Curves, Decoded

_CODECS: dict[str, Codec] = {
    module.NAME: module for module in (spline_wavelet, lagrange, hermite, daubechies, flight)
}


def encode(basis: Mapping[str, Any], states: Curves, controls: Curves) -> dict[str, Any]:
    """The ``coefficients`` of a result."""
    return _CODECS[basis["name"]].encode(basis, states, controls)


def decode(coefficients: Mapping[str, Any], node_controls: Mapping[str, Any], duration: float) -> Decoded:
    """The curves of stored coefficients, over tau in [0, 1].

    ``node_controls`` are the controls at the nodes of the same result, ``duration`` is tf - t0.
    Raises KeyError for a basis that this version does not know.
    """
    return _CODECS[coefficients["basis"]["name"]].decode(coefficients, node_controls, duration)
