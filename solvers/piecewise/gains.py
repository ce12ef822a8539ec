"""Feedback along a reference: the linear-quadratic problem in Hermite-Simpson form, solved backwards.

With deviations x, u from the reference and its derivatives A, B at nodes k and midpoints, an interval of
length h obeys

    x_m = (x_0 + x_1)/2 + h/8 (A_0 x_0 + B_0 u_0 - A_1 x_1 - B_1 u_1)
    x_1 = x_0 + h/6 (A_0 x_0 + B_0 u_0 + 4 A_m x_m + 4 B_m u_m + A_1 x_1 + B_1 u_1)

and costs h/12 times x'Q x + u'R u at its ends and four times that at its midpoint. One pass from the end
carries the quadratic form of what is still to come in (x_k, u_k), eliminates x_1 and minimises over
(u_m, u_1): the same gains as the dense formula M^-1 C'(C M^-1 C')^-1, in time that is linear in the nodes.

Source: Zhu, Shi, "Piecewise Parallel Optimal Algorithm", IntechOpen 2018, doi 10.5772/intechopen.76625
(dense form); Bryson, Ho, Applied Optimal Control, 1975, 5.2 (backward sweep).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Weights:
    """Weights of the tracking: ``state`` Q and ``final`` S (n, n), ``control`` R (m, m); R > 0."""

    state: Vector
    control: Vector
    final: Vector


@dataclass(frozen=True)
class Gains:
    """Feedback at the N nodes where intervals begin: u_k = nodes[k] x_k, u_(k+1/2) = middles[k] x_k.

    Both (N, m, n).
    """

    nodes: Vector
    middles: Vector


def tracking_gains(
    a: Vector, b: Vector, lengths: Vector, weights: Weights, horizon: int | None = None
) -> Gains:
    """The gains along a reference of N intervals of ``lengths`` (N,).

    ``a`` (2 N + 1, n, n) and ``b`` (2 N + 1, n, m): derivatives of the rate at nodes and midpoints, in turn.
    ``horizon``: how many intervals each node looks ahead; None looks to the end, with one pass for all nodes.
    """
    ends, costs = _intervals(a, b, lengths[:, None, None], weights)
    if horizon is None or horizon >= lengths.size:
        found = _sweep(ends, costs, weights)
        found.reverse()
    else:
        windows = (slice(k, k + horizon) for k in range(lengths.size))
        found = [_sweep(ends[window], costs[window], weights)[-1] for window in windows]
    return Gains(np.array([gain for gain, _ in found]), np.array([gain for _, gain in found]))


def _intervals(a: Vector, b: Vector, h: Vector, weights: Weights) -> tuple[Vector, Vector]:
    """For each interval x_1 (N, n, n + 3 m) and the cost (N, ., .), both over (x_0, u_0, u_m, u_1)."""
    (a0, am, a1), (b0, bm, b1) = ((d[:-2:2], d[1::2], d[2::2]) for d in (a, b))
    count, n, m = b0.shape
    unit, size = np.eye(n), n + 3 * m
    x0, u0, um, u1 = (
        slice(start, stop) for start, stop in ((0, n), (n, n + m), (n + m, n + 2 * m), (n + 2 * m, size))
    )
    # The midpoint without what x_1 adds to it, then the interval's equation solved for x_1.
    middle = np.zeros((count, n, size))
    middle[:, :, x0] = unit / 2 + h / 8 * a0
    middle[:, :, u0] = h / 8 * b0
    middle[:, :, u1] = -h / 8 * b1
    from_end = unit / 2 - h / 8 * a1
    right = 4 * am @ middle
    right[:, :, x0] += a0
    right[:, :, u0] += b0
    right[:, :, um] += 4 * bm
    right[:, :, u1] += b1
    right *= h / 6
    right[:, :, x0] += unit
    after = np.linalg.solve(unit - h / 6 * (a1 + 4 * am @ from_end), right)
    middle += from_end @ after
    cost = 4 * middle.mT @ weights.state @ middle + after.mT @ weights.state @ after
    cost[:, x0, x0] += weights.state
    for place, factor in ((u0, 1), (um, 4), (u1, 1)):
        cost[:, place, place] += factor * weights.control
    return np.asarray(after, np.float64), np.asarray(h / 6 * cost, np.float64)


def _sweep(ends: Vector, costs: Vector, weights: Weights) -> list[tuple[Vector, Vector]]:
    """Gains of the first node and midpoint of each interval, the last interval first."""
    n, m = weights.state.shape[0], weights.control.shape[0]
    ahead = np.zeros((n + m, n + m))
    ahead[:n, :n] = weights.final
    end = np.zeros((n + m, n + 3 * m))
    end[n:, n + 2 * m :] = np.eye(m)
    found = []
    for after, cost in zip(ends[::-1], costs[::-1], strict=True):
        end[:n] = after
        form = cost + end.T @ ahead @ end
        later = -np.linalg.solve(form[n + m :, n + m :], form[n + m :, : n + m])
        ahead = form[: n + m, : n + m] + form[: n + m, n + m :] @ later
        ahead = (ahead + ahead.T) / 2
        node = -np.linalg.solve(ahead[n:, n:], ahead[n:, :n])
        found.append((node, later[:m, :n] + later[:m, n:] @ node))
    return found
