"""The backward sweep against the dense formula of the appendix, and against the Riccati equation."""

from __future__ import annotations

import time

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_are

from solvers.piecewise.gains import Weights, tracking_gains

Vector = NDArray[np.float64]


def reference(states: int, controls: int, intervals: int) -> tuple[Vector, Vector, Vector, Weights]:
    """Derivatives along some reference, positive weights."""
    rng = np.random.default_rng(states)
    tau = np.linspace(0.0, 1.0, 2 * intervals + 1)[:, None, None]
    a = rng.normal(size=(states, states)) + tau * rng.normal(size=(states, states))
    b = rng.normal(size=(states, controls)) + tau * rng.normal(size=(states, controls))

    def positive(size: int) -> Vector:
        root = rng.normal(size=(size, size))
        return np.asarray(root @ root.T + np.eye(size))

    weights = Weights(positive(states), positive(controls), positive(states))
    return a, b, rng.uniform(0.02, 0.05, intervals), weights


def dense_gains(a: Vector, b: Vector, lengths: Vector, weights: Weights) -> tuple[Vector, Vector]:
    """Z = M^-1 C'(C M^-1 C')^-1 X over all deviations: gains of the first node and of the first midpoint."""
    n, m, count = a.shape[1], b.shape[2], lengths.size
    size = (count + 1) * (n + m) + count * m
    x = [slice(k * n, (k + 1) * n) for k in range(count + 1)]
    first = (count + 1) * n
    u = [slice(first + k * m, first + (k + 1) * m) for k in range(2 * count + 1)]  # u_0, u_1/2, u_1, ...
    unit = np.eye(n)
    form, conditions = np.zeros((size, size)), np.zeros(((count + 1) * n, size))
    conditions[:n, x[0]] = unit
    for k, h in enumerate(lengths):
        (a0, am, a1), (b0, bm, b1) = a[2 * k : 2 * k + 3], b[2 * k : 2 * k + 3]
        u0, um, u1 = u[2 * k : 2 * k + 3]
        middle = np.zeros((n, size))
        middle[:, x[k]], middle[:, x[k + 1]] = unit / 2 + h / 8 * a0, unit / 2 - h / 8 * a1
        middle[:, u0], middle[:, u1] = h / 8 * b0, -h / 8 * b1
        form += h / 6 * 4 * middle.T @ weights.state @ middle
        for place in (x[k], x[k + 1]):
            form[place, place] += h / 6 * weights.state
        for place, factor in ((u0, 1), (um, 4), (u1, 1)):
            form[place, place] += h / 6 * factor * weights.control
        row = conditions[(k + 1) * n : (k + 2) * n]
        row[:, x[k]] = -unit - h / 6 * (a0 + 4 * am @ (unit / 2 + h / 8 * a0))
        row[:, x[k + 1]] = unit - h / 6 * (a1 + 4 * am @ (unit / 2 - h / 8 * a1))
        row[:, u0] = -h / 6 * (b0 + h / 2 * am @ b0)
        row[:, u1] = -h / 6 * (b1 - h / 2 * am @ b1)
        row[:, um] = -4 * h / 6 * bm
    form[x[count], x[count]] += weights.final
    start = np.zeros((conditions.shape[0], n))
    start[:n] = unit
    back = np.linalg.solve(form, conditions.T)
    found = back @ np.linalg.solve(conditions @ back, start)
    return found[u[0]], found[u[1]]


@pytest.mark.parametrize(("states", "controls", "intervals"), [(4, 1, 30), (8, 2, 10), (2, 2, 1)])
@pytest.mark.parametrize("horizon", [None, 4])
def test_gains_of_every_node_equal_the_dense_formula(
    states: int, controls: int, intervals: int, horizon: int | None
) -> None:
    a, b, lengths, weights = reference(states, controls, intervals)
    gains = tracking_gains(a, b, lengths, weights, horizon)
    for k in range(intervals):
        last = intervals if horizon is None else min(k + horizon, intervals)
        ahead = slice(2 * k, 2 * last + 1)
        node, middle = dense_gains(a[ahead], b[ahead], lengths[k:last], weights)
        np.testing.assert_allclose(gains.nodes[k], node, rtol=0, atol=1e-10 * np.abs(node).max())
        np.testing.assert_allclose(gains.middles[k], middle, rtol=0, atol=1e-10 * np.abs(middle).max())


def test_gains_far_from_the_end_are_those_of_the_riccati_equation() -> None:
    a, b = np.array([[0.0, 1.0], [2.0, -0.1]]), np.array([[0.0], [1.0]])
    weights = Weights(np.diag([4.0, 1.0]), np.array([[0.5]]), np.eye(2))
    count = 400
    gains = tracking_gains(
        np.tile(a, (2 * count + 1, 1, 1)), np.tile(b, (2 * count + 1, 1, 1)), np.full(count, 0.05), weights
    )
    cost = solve_continuous_are(a, b, weights.state, weights.control)
    np.testing.assert_allclose(gains.nodes[0], -2.0 * b.T @ cost, rtol=1e-3)


def test_a_state_without_weight_needs_no_care() -> None:
    a, b, lengths, weights = reference(4, 1, 10)
    free = Weights(np.diag([1.0, 1.0, 0.0, 0.0]), weights.control, np.zeros((4, 4)))
    assert np.isfinite(tracking_gains(a, b, lengths, free).nodes).all()


@pytest.mark.parametrize(("states", "controls", "intervals", "limit"), [(8, 2, 10, 3e-3), (4, 1, 30, 5e-3)])
def test_all_gains_of_a_segment_cost_milliseconds(
    states: int, controls: int, intervals: int, limit: float
) -> None:
    a, b, lengths, weights = reference(states, controls, intervals)
    times = []
    for _ in range(20):
        start = time.process_time()
        tracking_gains(a, b, lengths, weights)
        times.append(time.process_time() - start)
    assert min(times) < limit
