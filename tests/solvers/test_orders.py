"""The order of convergence of every method on smooth problems with closed forms.

Derivation for the spline wavelets. Second order: q'' is piecewise linear and exact at the knots, so it errs
by h^2 between them and every integral of it, the objective too, converges with order 2. First order: x' is a
quadratic spline that is exact at its n + 2 Greville points, whose quadrature has degree 2: the objective
converges with order 3. Hermite-Simpson: Simpson's rule, order 4. Gauss: faster than any power.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document


def regulator_state(t: np.ndarray) -> np.ndarray:
    return np.cosh(1 - t) / np.cosh(1)


def oscillator_coefficients() -> tuple[float, float]:
    """u = a cos t + b sin t drives x = a t sin(t) / 2 + b (sin(t) - t cos(t)) / 2 to rest at 1 at t = 2."""
    s, c = np.sin(2.0), np.cos(2.0)
    matrix = [[s, (s - 2 * c) / 2], [(s + 2 * c) / 2, s]]
    a, b = np.linalg.solve(matrix, [1.0, 0.0])
    return float(a), float(b)


def oscillator_state(t: np.ndarray) -> np.ndarray:
    a, b = oscillator_coefficients()
    return a * t * np.sin(t) / 2 + b * (np.sin(t) - t * np.cos(t)) / 2


def oscillator_objective() -> float:
    a, b = oscillator_coefficients()
    return (a**2 * (1 + np.sin(4) / 4) + b**2 * (1 - np.sin(4) / 4) + a * b * np.sin(2) ** 2) / 2


def errors(
    document: dict[str, Any],
    methods: list[dict[str, Any]],
    exact: Callable[[np.ndarray], np.ndarray],
    objective: float,
) -> np.ndarray:
    """(objective, largest state error at the nodes) for each method."""
    found = []
    for method in methods:
        solution: Solution = solve(
            check_document({**document, "method": method, "options": {"tolerance": 1e-12}})
        )
        trajectory = solution.trajectory
        states = trajectory.states_at(trajectory.nodes)[0]
        error = np.max(np.abs(states - exact(trajectory.time(trajectory.nodes))))
        found.append([abs(solution.objective - objective), error])
    return np.array(found)


def orders(error: np.ndarray) -> np.ndarray:
    return np.log2(error[:-1] / error[1:])


HALVED = {
    "swcm": [{"name": "swcm", "L": 5, "J": J} for J in (2, 3, 4)],
    "hermite_simpson": [{"name": "hermite_simpson", "intervals": n} for n in (8, 16, 32)],
}


@pytest.mark.parametrize(("name", "order"), [("swcm", 3), ("hermite_simpson", 4)])
def test_order_of_the_objective_on_a_first_order_model(
    regulator: dict[str, Any], name: str, order: int
) -> None:
    error = errors(regulator, HALVED[name], regulator_state, np.tanh(1) / 2)
    np.testing.assert_allclose(orders(error)[:, 0], order, atol=0.1)


@pytest.mark.parametrize(("name", "order"), [("swcm", 2), ("hermite_simpson", 4)])
def test_order_of_objective_and_states_on_a_second_order_model(
    oscillator: dict[str, Any], name: str, order: int
) -> None:
    error = errors(oscillator, HALVED[name], oscillator_state, oscillator_objective())
    np.testing.assert_allclose(orders(error), order, atol=0.1)


@pytest.mark.parametrize("segments", [1, 2])
def test_gauss_points_converge_spectrally(oscillator: dict[str, Any], segments: int) -> None:
    methods = [{"name": "gpm", "nodes": nodes, "segments": segments} for nodes in (3, 5, 7, 9)]
    error = errors(oscillator, methods, oscillator_state, oscillator_objective())
    # Two more nodes divide the error by more each time, until only rounding is left.
    ratios = error[:-1, 1] / error[1:, 1]
    assert np.all(ratios > 15)
    assert np.all(np.diff(ratios) > 0)
    assert error[-1, 0] < 1e-13


def test_gauss_segments_converge_with_order_two_n(oscillator: dict[str, Any]) -> None:
    methods = [{"name": "gpm", "nodes": 2, "segments": n} for n in (4, 8, 16)]
    error = errors(oscillator, methods, oscillator_state, oscillator_objective())
    np.testing.assert_allclose(orders(error)[:, 0], 4, atol=0.2)
