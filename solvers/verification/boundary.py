"""How far boundary constraints are violated by the ends of a flight, as an error of these ends.

An expression at the ends has no history that would tell its size, and where it holds it is mostly 0, as
``r_f*vt_f^2/mu - 1`` on a circular orbit. So a violation is taken relative to what the expression changes by
when all that it is made of moves by its scale, sum_i |dc/dz_i| s_i. To first order that is the componentwise
backward error (Higham, Accuracy and Stability of Numerical Algorithms, 2002, section 7.2); ``x_f - 3 = 0`` is
judged as the final state 3 is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.formulation.quantities import Constraint
from solvers.verification.violations import SMALLEST_SCALE, scaled_violation

Vector = NDArray[np.float64]
End = tuple[Vector, Vector, float]
"""States (n,), controls (m,) and time."""
Scales = tuple[Vector, Vector]
"""Those of states (n,) and controls (m,)."""

# By this part of its scale a quantity is moved to see what a constraint makes of it.
_STEP = 1e-6


def boundary_violation(
    constraints: Sequence[Constraint],
    ends: tuple[End, End],
    scales: tuple[Scales, Scales],
    integrals: Vector,
    scope_of: Callable[[Any, Any, Any], Mapping[str, Any]],
) -> float:
    """The largest violation at these ends (states, controls, time) and integrals; NaN is infinitely far off.

    ``scope_of`` names what the expressions know, from such ends and integrals with a column for each place.
    An expression that is larger than what it is moved by is judged by its own size.
    """
    if not constraints:
        return 0.0
    late = max(abs(time) for _, _, time in ends)
    values = [*ends[0][:2], np.array([ends[0][2]]), *ends[1][:2], np.array([ends[1][2]]), integrals]
    sizes = [*scales[0], np.array([late]), *scales[1], np.array([late]), np.abs(integrals)]
    steps = _STEP * np.diag(np.concatenate(sizes))
    moves = np.hstack([np.zeros((len(steps), 1)), steps, -steps])
    rows = np.split(np.concatenate(values)[:, None] + moves, np.cumsum([own.size for own in values])[:-1])
    first, last = ((rows[k], rows[k + 1], rows[k + 2][0]) for k in (0, 3))
    scope = scope_of(first, last, rows[6])
    return max(_violation(item, scope, moves.shape[1]) for item in constraints)


def _violation(constraint: Constraint, scope: Mapping[str, Any], places: int) -> float:
    """The violation at the first place; the others are it moved forth, then back."""
    with np.errstate(all="ignore"):
        value = constraint.expression.evaluate(scope, NUMPY.functions)
        values = np.broadcast_to(np.asarray(value, np.float64), (places,))
        forth, back = np.split(values[1:], 2)
        moved = np.abs(forth - back) / (2.0 * _STEP)
    response = float(np.sum(moved, where=np.isfinite(moved)))
    own = abs(float(values[0])) if np.isfinite(values[0]) else 0.0
    size = np.array([max(SMALLEST_SCALE, constraint.scale, own, response)])
    return scaled_violation(values[:1, None].T, np.array([constraint.interval]), size)
