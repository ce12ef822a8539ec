"""Several starts: reproducible, within bounds, and the best answer is kept."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from solvers.formulation.stated import stated_problem
from solvers.solve import solve
from solvers.spec import check_document
from solvers.start.scaling import automatic_scaling
from solvers.start.starts import several_starts

# x' = u, |u| <= 1, minimise -x(2)^2 - x(2)/10 from x = 0: local optima at both ends, J = -4.2 and -3.8.
TWO_ENDS: dict[str, Any] = {
    "problem": {
        "model": {"kind": "first_order", "states": ["x"], "controls": ["u"], "dynamics": {"x": "u"}},
        "final_time": 2,
        "initial_state": {"x": 0},
        "bounds": {"u": [-1, 1], "x": [-3, 3]},
        "objective": {"terminal": "-x_f^2 - x_f/10"},
        "guess": {"controls": {"u": [-1]}, "states": {"x": [0, -2]}},
    },
    "method": {"name": "hermite_simpson", "intervals": 10},
}


def test_starts_are_the_same_every_time_and_respect_bounds(flexible_spacecraft: dict[str, Any]) -> None:
    problem = stated_problem(check_document(flexible_spacecraft).problem)
    scaling = automatic_scaling(problem)
    tau = np.linspace(0, 1, 41)
    first, again = (several_starts(problem, scaling, 9) for _ in range(2))
    assert first[0] is problem.guess
    for start, same in zip(first, again, strict=True):
        np.testing.assert_array_equal(start.controls_at(tau), same.controls_at(tau))
        assert np.all(np.abs(start.controls_at(tau)) <= 5.0)
        assert 1.0 <= start.tf <= 100.0
        np.testing.assert_allclose(
            start.states_at(tau)[:, [0, -1]], problem.guess.states_at(tau)[:, [0, -1]], atol=1e-14
        )
    different = {float(start.controls_at(np.array([0.5]))[0, 0]) for start in first}
    assert len(different) == 9


def test_the_best_of_several_local_optima_is_kept_and_the_others_are_reported() -> None:
    alone = solve(check_document(TWO_ENDS))
    assert alone.objective == pytest.approx(-3.8)
    several = solve(check_document({**TWO_ENDS, "options": {"starts": 6}}))
    assert several.objective == pytest.approx(-4.2)
    assert several.success
    objectives = [start["objective"] for start in several.starts]
    assert len(objectives) == 6
    assert min(objectives) == pytest.approx(-4.2)
    assert max(objectives) == pytest.approx(-3.8)
    assert [start["objective"] for start in several.starts if start["kept"]] == [several.objective]


def test_other_switching_structures_are_reported_with_what_is_wrong_with_them(
    flexible_spacecraft: dict[str, Any],
) -> None:
    """Controls with three switches that reach the target; all but the optimum break Pontryagin's signs."""
    flexible_spacecraft["method"] = {"name": "swcm", "refine": "switching"}
    flexible_spacecraft["options"] = {"starts": 5}
    solution = solve(check_document(flexible_spacecraft))
    assert solution.success
    assert solution.objective == pytest.approx(25.866100388133, abs=1e-8)
    others = [start for start in solution.starts if "switching" in start]
    found = [start["final_time"] for start in others]
    assert found == sorted(found)
    # By SciPy's least squares on the final state over four durations, from random ones.
    for known in (27.6891, 30.2905):
        assert min(abs(tf - known) for tf in found) < 1e-4
    for start in others:
        assert start["wrong_sign"] > 0.1
        assert not start["kept"]
        assert final_state(start["switching"]["T"], start["final_time"]) == pytest.approx(
            [np.pi / 6, 0, 0, 0], abs=1e-6
        )


def final_state(switches: list[float], final_time: float) -> list[float]:
    """The slew flown by its equations with the full torque, whichever way comes nearer to the target."""

    def rate(_: float, x: np.ndarray, torque: float) -> list[float]:
        _, alpha, spin, bend = x
        coupling, swing = 500 + 250 * np.cos(alpha), 250 * np.sin(alpha)
        mass = [[1065 + 500 * np.cos(alpha), coupling], [coupling, 500]]
        load = [torque + 2 * swing * spin * bend + swing * bend**2, -swing * spin**2 - 200 * alpha]
        return [spin, bend, *np.linalg.solve(mass, load)]

    ends = []
    for torque in (5.0, -5.0):
        x = np.zeros(4)
        for start, stop in pairwise([0.0, *switches, final_time]):
            x = solve_ivp(rate, (start, stop), x, args=(torque,), rtol=1e-9, atol=1e-12).y[:, -1]
            torque = -torque
        ends.append(x)
    return min(ends, key=lambda x: abs(x[0] - np.pi / 6)).tolist()
