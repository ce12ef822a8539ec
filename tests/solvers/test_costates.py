"""Costates against closed forms: lambda = dJ*/dx, H = L + lambda' f minimised."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.certificate import hamiltonian
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document


def solved(document: dict[str, Any], **method: Any) -> Solution:
    return solve(check_document({**document, "method": method, "options": {"tolerance": 1e-11}}))


METHODS = [
    ({"name": "swcm", "J": 4}, 1e-3),
    ({"name": "swcm", "J": 4, "adaptive": {"tolerance": 1, "max_level": 4}}, 1e-3),
    ({"name": "gpm", "nodes": 12}, 1e-10),
    ({"name": "gpm", "nodes": 6, "segments": 3}, 1e-7),
    ({"name": "hermite_simpson", "intervals": 20}, 1e-3),
]


@pytest.mark.parametrize(("method", "limit"), METHODS)
def test_first_order(regulator: dict[str, Any], method: dict[str, Any], limit: float) -> None:
    """H is stationary in u: lambda = -u = sinh(1 - t) / cosh(1)."""
    solution = solved(regulator, **method)
    t = solution.trajectory.time(solution.trajectory.nodes)
    np.testing.assert_allclose(solution.costates, [np.sinh(1 - t) / np.cosh(1)], atol=limit)


@pytest.mark.parametrize(("method", "limit"), METHODS)
def test_second_order(oscillator: dict[str, Any], method: dict[str, Any], limit: float) -> None:
    """lambda_v = -u = -(a cos t + b sin t), lambda_q = -lambda_v'."""
    s, c = np.sin(2.0), np.cos(2.0)
    a, b = np.linalg.solve([[s, (s - 2 * c) / 2], [(s + 2 * c) / 2, s]], [1.0, 0.0])
    solution = solved(oscillator, **method)
    t = solution.trajectory.time(solution.trajectory.nodes)
    expected = [b * np.cos(t) - a * np.sin(t), -a * np.cos(t) - b * np.sin(t)]
    np.testing.assert_allclose(solution.costates, expected, atol=limit)


def test_second_order_spline_costates_converge_with_order_two(oscillator: dict[str, Any]) -> None:
    s, c = np.sin(2.0), np.cos(2.0)
    a, b = np.linalg.solve([[s, (s - 2 * c) / 2], [(s + 2 * c) / 2, s]], [1.0, 0.0])
    errors = []
    for level in (2, 3, 4):
        solution = solved(oscillator, name="swcm", J=level)
        t = solution.trajectory.time(solution.trajectory.nodes)
        errors.append(np.max(np.abs(solution.costates[0] - (b * np.cos(t) - a * np.sin(t)))))
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.1)


@pytest.mark.parametrize(
    ("method", "limit"),
    [({"name": "swcm", "J": 6}, 4e-3), ({"name": "hermite_simpson", "intervals": 200}, 2e-2)],
)
def test_the_hamiltonian_of_a_minimum_time_slew_is_minus_one(
    flexible_spacecraft: dict[str, Any], method: dict[str, Any], limit: float
) -> None:
    solution = solved(flexible_spacecraft, **method)
    values = hamiltonian(solution.problem, solution.trajectory, solution.costates)
    np.testing.assert_allclose(values, -1.0, atol=limit)
    drift = solution.verification.hamiltonian_drift
    assert drift is not None
    assert drift <= limit


def test_a_problem_that_names_the_time_has_no_drift(regulator: dict[str, Any]) -> None:
    regulator["problem"]["model"]["dynamics"]["x"] = "u + t"
    assert solved(regulator, name="gpm", nodes=10).verification.hamiltonian_drift is None
