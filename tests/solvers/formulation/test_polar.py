"""Vectors of two controls that cost their length."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from solvers.curves import Curve, LagrangeCurve, LinearCurve
from solvers.formulation.polar import in_polar
from solvers.formulation.stated import stated_problem
from solvers.problem import OptimalControlProblem
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document

PUSHED: dict[str, Any] = {
    "problem": {
        "model": {
            "kind": "first_order",
            "states": ["x", "y", "vx", "vy"],
            "controls": ["ux", "spin", "uy"],
            "dynamics": {"x": "vx", "y": "vy", "vx": "ux", "vy": "uy + 0*spin"},
        },
        "final_time": 6,
        "initial_state": {"*": 0},
        "final_state": {"x": 3, "y": 4, "vx": 0, "vy": 0},
        "bounds": {"spin": [0, 1]},
        "path_constraints": [{"name": "thrust", "expression": "sqrt(ux*ux + uy^2)", "bounds": [None, 1]}],
        "objective": {"running": "sqrt(ux^2 + uy^2) + spin^2"},
    }
}


def problem_of(document: dict[str, Any]) -> OptimalControlProblem:
    return stated_problem(check_document(document).problem)


def test_a_push_a_coast_and_a_stop() -> None:
    """5 m in 6 s with at most 1 m/s^2: one second of thrust at both ends, for 1 (6 - 1) = 5, costs 2 m/s."""
    solution = solve(check_document(PUSHED))
    assert isinstance(solution, Solution)
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(2.0, abs=1e-8)
    controls = solution.trajectory.controls
    assert list(controls) == ["ux", "spin", "uy"]
    tau = np.array([0.1, 0.5, 0.9])
    np.testing.assert_allclose(controls["ux"](tau), [0.6, 0.0, -0.6], atol=1e-6)
    np.testing.assert_allclose(controls["uy"](tau), [0.8, 0.0, -0.8], atol=1e-6)
    assert set(solution.switching) <= {"ux", "spin", "uy"}
    (limit,) = [item for item in solution.constraints if "path_constraints" in item["pointer"]]
    assert limit["max"] == pytest.approx(1.0, abs=1e-6)
    assert solution.sensitivity is not None
    # With a larger limit a: a burn of tau, 5 = a tau (6 - tau), costs 2 a tau; d/da = -2 tau^2 / (6 - 2 tau).
    assert solution.sensitivity["/problem/path_constraints/0/bounds/1"] == pytest.approx(-0.5, rel=1e-3)
    # From there with more time: t (6.3 - t) = 5 for a burn of t. The arcs are known, few steps are left.
    longer = {"problem": {**PUSHED["problem"], "final_time": 6.3}, "warm_start": "the first one"}
    again = solve(check_document(longer), earlier=solution.trajectory)
    assert again.success, again.message
    assert again.objective == pytest.approx(6.3 - np.sqrt(6.3**2 - 20), abs=1e-8)
    assert again.statistics.iterations <= solution.statistics.iterations / 3


@pytest.mark.parametrize("kind", ["polynomials", "lines"])
def test_an_earlier_answer_is_read_as_length_and_angle(kind: str) -> None:
    """A vector that turns by two whole turns, from length 2 to none, and is off in the middle."""
    (pair,) = in_polar(problem_of(PUSHED))[1]
    tau = np.linspace(0.0, 1.0, 121)
    length, angle = np.where(np.abs(tau - 0.5) < 0.1, 0.0, 2.0 - tau), 4.0 * np.pi * tau + 0.3

    def curve(values: np.ndarray) -> Curve:
        if kind == "lines":
            return LinearCurve(tau, values)
        support = np.array([-1.0, 0.0, 1.0])
        pieces = tuple(values[first : first + 3] for first in range(0, 119, 2))
        return LagrangeCurve(tau[::2], (support,) * 60, pieces)

    components = {"ux": curve(length * np.cos(angle)), "uy": curve(length * np.sin(angle))}
    found = pair.replaced(components)
    assert set(found) == {"size@ux", "angle@ux"}
    np.testing.assert_allclose(found["size@ux"](tau), length, atol=1e-12)
    np.testing.assert_allclose(found["angle@ux"](tau), angle, atol=0.2 if kind == "polynomials" else 1e-9)
    both = pair.components(found)
    for name, expected in components.items():
        np.testing.assert_allclose(both[name](tau), expected(tau), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({}, True),
        ({"initial_control": {"ux": 0}}, False),
        ({"objective": {"running": "ux^2 + uy^2 + spin^2"}}, False),
        ({"objective": {"running": "sqrt(ux^2 + 2*uy^2)"}}, False),
        ({"objective": {"running": "sqrt(ux^2 + uy^2 + 0.1)"}}, False),
    ],
)
def test_what_counts_by_its_length(change: dict[str, Any], found: bool) -> None:
    document = copy.deepcopy(PUSHED)
    document["problem"] |= change
    problem, pairs = in_polar(problem_of(document))
    assert bool(pairs) == found
    assert problem.controls == (("spin", "size@ux", "angle@ux") if found else ("ux", "spin", "uy"))
    assert not found or problem.control_bounds == ((0.0, 1.0), (0.0, 1.0), (-np.inf, np.inf))
