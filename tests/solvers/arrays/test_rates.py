"""Rates over arrays against equations that were solved by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.arrays.rates import Rates
from solvers.formulation.stated import stated_problem
from solvers.spec import check_document

K = 7
RANDOM = np.random.default_rng(5)
Q1, Q2, V1, V2, U = RANDOM.standard_normal((5, K))
T = np.linspace(0.0, 3.0, K)


def rates_of(model: dict[str, Any], running: str) -> np.ndarray:
    document = {
        "problem": {
            "model": {"kind": "mechanical", "coordinates": ["q1", "q2"], "controls": ["u"], **model},
            "final_time": 1,
            "initial_state": {"*": 1},
            "objective": {"running": running},
        },
    }
    problem = stated_problem(check_document(document).problem)
    rates = Rates(problem, problem.parameters, [None, problem.running_cost])
    # Twice: what is kept from one call must not show in the next.
    rates(np.ones((4, K)), np.ones((1, K)), np.ones(K))
    return rates(np.vstack([Q1, Q2, V1, V2]), U[None, :], T)


def test_a_mass_matrix_without_a_pivot_on_its_diagonal() -> None:
    found = rates_of(
        {"mass": [[0, 1], [1, 0]], "input": [[1], [0]], "force": ["t", "-q1"]}, "q1_ddot^2 + q2_ddot*t"
    )
    first, second = -Q1, U + T
    assert found == pytest.approx(np.vstack([V1, V2, first, second, 0 * T, first**2 + second * T]))


def test_a_mass_matrix_that_moves_with_damping_stiffness_and_parameters() -> None:
    found = rates_of(
        {
            "parameters": {"m": 3},
            "definitions": {"c": "cos(q2)"},
            "mass": [["m + c", 0], [0, 2]],
            "damping": [["q2_dot", 0], [0, "m"]],
            "stiffness": [[0, 0], [0, 5]],
            "input": [["c"], [1]],
        },
        "u^2",
    )
    first = (np.cos(Q2) * U - V2 * V1) / (3 + np.cos(Q2))
    second = (U - 3 * V2 - 5 * Q2) / 2
    assert found == pytest.approx(np.vstack([V1, V2, first, second, 0 * T, U**2]))
