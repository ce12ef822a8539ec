"""The verification finds what is wrong, and only that."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solvers.curves import LagrangeCurve, LinearCurve
from solvers.formulation.stated import stated_problem
from solvers.problem import OptimalControlProblem
from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory
from solvers.verification.flight import ControlledModel
from solvers.verification.verdict import Tolerances, Verification
from solvers.verification.verify import verify


def checked(problem: OptimalControlProblem, trajectory: Trajectory) -> Verification:
    return verify(problem, trajectory, Tolerances(), time.monotonic() + 60)


def failed(verification: Verification) -> set[str]:
    return {check.name for check in verification.checks if not check.passed}


def piecewise(breaks: np.ndarray, values: np.ndarray) -> LagrangeCurve:
    """A parabola on each segment by its values at start, middle and end."""
    return LagrangeCurve(breaks, (np.array([-1.0, 0.0, 1.0]),) * len(values), tuple(values))


def rest_to_rest(problem: OptimalControlProblem, push: float = 1.0) -> Trajectory:
    """The exact minimum-time push of the rigid body: x = t^2 / 2, then its mirror image; t_f = 2."""
    breaks = np.array([0.0, 0.5, 1.0])
    position = np.array([[0.0, 0.125, 0.5], [0.5, 0.875, 1.0]])
    velocity = np.array([[0.0, 0.5, 1.0], [1.0, 0.5, 0.0]])
    control = np.array([[push] * 3, [-push] * 3])
    return Trajectory(
        0.0,
        2.0,
        {"x": piecewise(breaks, position), "x_dot": piecewise(breaks, velocity)},
        {"u": piecewise(breaks, control)},
        "polynomial",
        {},
        breaks,
        breaks,
    )


@pytest.fixture
def problem(rigid_body: dict[str, Any]) -> OptimalControlProblem:
    return stated_problem(check_document(rigid_body).problem)


def test_the_exact_answer_passes_with_rounding_errors_only(problem: OptimalControlProblem) -> None:
    verification = checked(problem, rest_to_rest(problem))
    assert verification.passed
    assert verification.terminal_error is not None
    assert verification.terminal_error < 1e-11
    assert verification.max_state_error is not None
    assert verification.max_state_error < 1e-11
    assert verification.max_bound_violation == 0.0
    assert verification.objective == pytest.approx(2.0, abs=1e-12)


def test_a_flight_near_what_was_promised_is_as_exact_as_one_that_is_integrated_anew(
    rigid_body: dict[str, Any],
) -> None:
    """The promised states are off by what slopes make good; the integral of x^2 is 1/20 + 43/60."""
    rigid_body["problem"]["objective"] = {"running": "x^2"}
    problem = stated_problem(check_document(rigid_body).problem)
    exact = rest_to_rest(problem)
    model = ControlledModel(problem, exact, np.ones(2), np.inf)
    promised = exact.states_at(model.breakpoints)
    promised[:, 1:] += 3e-7
    slopes, arcs = model.linearised(promised[:, :-1])
    for growth in (model.growth(slopes), None):
        flight = model.fly(promised, slopes, arcs, growth)
        np.testing.assert_allclose(flight.states[:, -1], [1.0, 0.0], atol=2e-12)
        np.testing.assert_allclose(flight.integrals, [46.0 / 60.0], atol=2e-12)


def test_a_control_over_its_bound_is_clipped_and_reported(problem: OptimalControlProblem) -> None:
    """Flown at 1 instead of the promised 1.25, the body stops at 1 and not at 1.25."""
    exact = rest_to_rest(problem)
    states = {
        name: piecewise(curve.breaks, 1.25 * np.array(curve.values))
        for name, curve in exact.states.items()
        if isinstance(curve, LagrangeCurve)
    }
    verification = checked(problem, replace(rest_to_rest(problem, 1.25), states=states))
    assert verification.max_bound_violation == pytest.approx(0.25 / 1.25)
    assert verification.states["x"].terminal_error == pytest.approx(0.25, abs=1e-9)
    assert failed(verification) == {"terminal_error", "state_error", "bound"}


def test_a_promise_that_the_dynamics_break_is_located(problem: OptimalControlProblem) -> None:
    exact = rest_to_rest(problem)
    bent = np.array([[0.0, 0.125, 0.5], [0.5, 0.875 + 0.1, 1.0]])
    states = {**exact.states, "x": piecewise(exact.breakpoints, bent)}
    verification = checked(problem, replace(exact, states=states))
    assert failed(verification) == {"state_error"}
    report = verification.states["x"]
    assert report.max_error == pytest.approx(0.1, abs=1e-9)
    assert report.at == pytest.approx(1.5)
    assert verification.states["x_dot"].max_error == pytest.approx(0.0, abs=1e-11)


def test_a_wrong_start_is_found(problem: OptimalControlProblem) -> None:
    moved = replace(problem, initial_state=((0.5, 0.5), (0.0, 0.0)))
    assert failed(checked(moved, rest_to_rest(problem))) == {"ends"}


def test_a_missed_target_is_found_though_the_flight_is_as_promised(problem: OptimalControlProblem) -> None:
    moved = replace(problem, final_state=((1.5, 1.5), (0.0, 0.0)))
    assert failed(checked(moved, rest_to_rest(problem))) == {"terminal_error"}


@pytest.mark.parametrize(("limit", "passes"), [(0.21, True), (0.19, False)])
def test_an_implied_end_has_a_limit_of_its_own(
    problem: OptimalControlProblem, limit: float, passes: bool
) -> None:
    """The flight to 1 is as promised; asked for is 1.2, which is 0.2 of the scale 1 away."""
    missed = replace(problem, final_state=((1.2, 1.2), (0.0, 0.0)))
    end = time.monotonic() + 60
    found = verify(missed, rest_to_rest(problem), Tolerances(1e-6), end, implied={"x": limit})
    assert failed(found) == (set() if passes else {"implied_ends"})
    assert found.terminal_error == pytest.approx(0.2, abs=1e-9)
    # Where it was promised to be it must be as exactly as any other.
    promised = replace(rest_to_rest(problem), tf=2.02)
    assert "terminal_error" in failed(verify(missed, promised, Tolerances(1e-6), end, implied={"x": 0.5}))


def test_path_and_state_bounds_are_checked_between_nodes(rigid_body: dict[str, Any]) -> None:
    """The velocity reaches 1 in the middle only."""
    rigid_body["problem"]["bounds"]["x_dot"] = [None, 0.8]
    rigid_body["problem"]["path_constraints"] = [{"expression": "x_dot + x", "bounds": [None, 1.2]}]
    problem = stated_problem(check_document(rigid_body).problem)
    verification = checked(problem, rest_to_rest(problem))
    assert verification.max_bound_violation == pytest.approx(0.2)
    assert verification.max_path_violation == pytest.approx(0.3 / 1.5, rel=1e-2)
    assert failed(verification) == {"bound", "path"}


def test_corners_of_a_clipped_control_are_flown_exactly(problem: OptimalControlProblem) -> None:
    """u = 3 - 3 tau clipped to [-1, 1] is 1 until t = 4/3, then falls: x' = 4/3 + 1/3 at t = 2."""
    ramp = LinearCurve(np.array([0.0, 1.0]), np.array([3.0, 0.0]))
    trajectory = replace(rest_to_rest(problem), controls={"u": ramp}, breakpoints=np.array([0.0, 1.0]))
    verification = checked(problem, trajectory)
    # Integral of min(1, 3 - 1.5 t) over [0, 2]: 4/3 + 1/3; the promised end was 0.
    assert verification.states["x_dot"].terminal_error == pytest.approx(5.0 / 3.0, abs=1e-10)


def test_growth_makes_the_end_of_an_unstable_flight_meaningless_but_not_its_arcs() -> None:
    """The open-loop flight of x' = x + u over 40 time constants grows rounding by e^40."""
    document = {
        "problem": {
            "model": {"kind": "first_order", "states": ["x"], "controls": ["u"], "dynamics": {"x": "x + u"}},
            "final_time": 40,
            "initial_state": {"x": 1},
            "final_state": {"x": 1},
            "objective": {"running": "u^2"},
        },
        "method": {"name": "hermite_simpson", "intervals": 200},
    }
    solution = solve(check_document(document))
    assert solution.verification.growth == pytest.approx(np.exp(40), rel=1e-3)
    assert solution.verification.terminal_error is None
    assert solution.success
    assert "from breakpoint to breakpoint" in solution.message


def test_out_of_time_is_a_failed_check_and_not_a_zero(problem: OptimalControlProblem) -> None:
    verification = verify(problem, rest_to_rest(problem), Tolerances(), time.monotonic() - 1)
    assert verification.terminal_error is None
    assert verification.max_state_error is None
    assert {"terminal_error", "state_error"} <= failed(verification)
    assert "time" in verification.note


def test_a_constraint_without_a_value_is_not_a_constraint_that_holds(rigid_body: dict[str, Any]) -> None:
    rigid_body["problem"]["path_constraints"] = [{"expression": "sqrt(x - 0.5)", "bounds": [None, 5]}]
    problem = stated_problem(check_document(rigid_body).problem)
    assert failed(checked(problem, rest_to_rest(problem))) == {"path"}
