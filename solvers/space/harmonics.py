"""The gradient of a potential given by spherical harmonics, in Cartesian coordinates.

    U = sum_n sum_m (a/r)^(n+1) (c_nm cos m l + s_nm sin m l) P_nm(sin phi)

The solid harmonics V_nm, W_nm follow from each other by recursions in x, y, z without angles, so that nothing
is singular at the poles and symbols can be differentiated.

Source: Cunningham, Celestial Mechanics 2, 1970; Montenbruck, Gill, Satellite Orbits, Springer 2000, 3.2.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Term = tuple[int, int, float, float]
"""n, m, c_nm, s_nm of harmonics that are not normalised."""
Table = dict[tuple[int, int], Any]


def gradient(terms: Sequence[Term], radius: float, x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    """a grad U at a place in the unit of ``radius`` a, along the same axes."""
    v, w = _solid_harmonics(
        x, y, z, radius, degree=1 + max(term[0] for term in terms), order=1 + max(term[1] for term in terms)
    )
    ux, uy, uz = 0.0, 0.0, 0.0
    for n, m, c, s in terms:
        up, down = (n + 1, m + 1), (n + 1, m - 1)
        if m == 0:
            ux, uy = ux - c * v[up], uy - c * w[up]
        else:
            factor = (n - m + 2) * (n - m + 1)
            ux = ux + 0.5 * (factor * (c * v[down] + s * w[down]) - c * v[up] - s * w[up])
            uy = uy + 0.5 * (factor * (s * v[down] - c * w[down]) + s * v[up] - c * w[up])
        uz = uz - (n - m + 1) * (c * v[n + 1, m] + s * w[n + 1, m])
    return ux, uy, uz


def _solid_harmonics(
    x: Any, y: Any, z: Any, radius: float, *, degree: int, order: int
) -> tuple[Table, Table]:
    """V_nm and W_nm = (a/r)^(n+1) P_nm(sin phi) {cos, sin}(m l)."""
    square = x * x + y * y + z * z
    sx, sy, sz, near = radius * x / square, radius * y / square, radius * z / square, radius**2 / square
    v: Table = {(0, 0): radius / square**0.5}
    w: Table = {(0, 0): 0.0}
    for m in range(order + 1):
        if m:
            before = m - 1, m - 1
            v[m, m] = (2 * m - 1) * (sx * v[before] - sy * w[before])
            w[m, m] = (2 * m - 1) * (sx * w[before] + sy * v[before])
        for n in range(m + 1, degree + 1):
            for table in (v, w):
                table[n, m] = (2 * n - 1) / (n - m) * sz * table[n - 1, m]
                if n > m + 1:
                    table[n, m] = table[n, m] - (n + m - 1) / (n - m) * near * table[n - 2, m]
    return v, w
