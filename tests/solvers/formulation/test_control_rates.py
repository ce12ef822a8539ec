"""Controls whose rates are bounded: they are continuous, and both bounds hold between the nodes too."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np
import pytest

from solvers.derivatives import compile_program
from solvers.formulation.stated import stated_problem
from solvers.sizes import problem_size
from solvers.solve import solve
from solvers.spec import check_document
from solvers.start.guess import WarmStart
from solvers.trajectory import Trajectory
from tests.solvers.output.test_outputs import each_method, result_of
from tests.solvers.test_program import transcribe

MECHANICAL = {
    "kind": "mechanical",
    "coordinates": ["x"],
    "controls": ["u"],
    "mass": [[1]],
    "input": [[1]],
}
FIRST_ORDER = {
    "kind": "first_order",
    "states": ["x", "x_v"],
    "controls": ["u"],
    "dynamics": {"x": "x_v", "x_v": "u"},
}
each_model = pytest.mark.parametrize("model", [MECHANICAL, FIRST_ORDER], ids=["second order", "first order"])
# Rest to rest over 1 with |x''| <= 1, |x'''| <= 2 and no acceleration at either end: with the time t = 1/2
# of a ramp, T = t + sqrt(t^2 + 4), and the rate switches at t, T/2 - t, T/2 + t, T - t.
RAMP = 0.5
SHORTEST = RAMP + np.sqrt(RAMP**2 + 4)


def rest_to_rest(model: dict[str, Any]) -> dict[str, Any]:
    velocity = "x_dot" if model["kind"] == "mechanical" else "x_v"
    return {
        "problem": {
            "model": model,
            "final_time": [0.1, 10],
            "initial_state": {"x": 0, velocity: 0},
            "final_state": {"x": 1, velocity: 0},
            "bounds": {"u": [-1, 1]},
            "control_rates": {"u": [-2, 2]},
            "initial_control": {"u": 0},
            "final_control": {"u": 0},
            "objective": {"terminal": "tf"},
        }
    }


@each_method
@each_model
def test_the_shortest_time_with_bounded_jerk(model: dict[str, Any], method: dict[str, Any]) -> None:
    if method["name"] == "gpm":
        method = {**method, "nodes": 60}
    result = result_of({**rest_to_rest(model), "method": method})
    assert result["final_time"] == pytest.approx(SHORTEST, abs=6e-3)
    if method["name"] == "gpm":  # its polynomials overshoot between the nodes, and the verification says so
        assert not result["success"]
        return
    assert result["success"], result["message"]
    trajectory = Trajectory.from_result(json.loads(json.dumps(result)))
    tau = np.linspace(0, 1, 5001)
    control = trajectory.states["u"](tau)
    assert control[[0, -1]] == pytest.approx([0, 0], abs=1e-8)
    assert np.abs(control).max() <= 1 + (1e-7 if method["name"] == "swcm" else 2e-3)
    assert np.abs(trajectory.controls["u_dot"](tau)).max() <= 2 + 1e-7
    np.testing.assert_allclose(trajectory.rates_at(tau)[2], trajectory.controls["u_dot"](tau), atol=1e-6)


@each_method
@each_model
def test_refinement_acts_on_the_rate(model: dict[str, Any], method: dict[str, Any]) -> None:
    result = result_of({**rest_to_rest(model), "method": {**method, "refine": "switching"}})
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(SHORTEST, abs=1e-9)
    half = SHORTEST / 2
    switching = result["switching"]["u_dot"]
    assert switching["times"] == pytest.approx([RAMP, half - RAMP, half + RAMP, SHORTEST - RAMP], abs=1e-7)
    assert switching["levels"] == [2, None, -2, None, 2]
    # Minimum time: H = -1, with the costate of the control that has become a state.
    assert result["verification"]["hamiltonian_drift"] < 1e-6


@each_method
@each_model
def test_the_smallest_integral_of_the_squared_rate(model: dict[str, Any], method: dict[str, Any]) -> None:
    """Rest to rest over 1 in time 1 without acceleration at the ends: the integral of x'''^2 is 720."""
    document = rest_to_rest(model)
    document["problem"] |= {"final_time": 1, "bounds": {}, "objective": {"running": "u_dot^2"}}
    document["problem"]["control_rates"] = {"u": None}
    document["problem"]["path_constraints"] = [{"expression": "u_dot", "bounds": [-100, 100]}]
    result = result_of({**document, "method": method})
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(720, rel=2e-3)
    assert result["verification"]["objective"] == pytest.approx(720, rel=2e-3)


def test_the_smallest_change_of_a_control() -> None:
    """By 1 in 2.5 from rest to rest with |u'| <= 5: from a down to -a within 2 a/5.

    a (T^2/4 - w^2/12) = 1 with w = 2 a/5, so that a = 0.64226; the cost is 2 a.
    """
    document = {
        "problem": {
            "model": MECHANICAL,
            "final_time": 2.5,
            "initial_state": {"*": 0},
            "final_state": {"x": 1, "x_dot": 0},
            "bounds": {"u": [-1, 1]},
            "control_rates": {"u": [-5, 5]},
            "objective": {"running": "abs(u_dot)"},
        },
        "method": {"name": "hermite_simpson", "intervals": 40},
    }
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(1.2845215, abs=2e-3)
    assert result["verification"]["objective"] == pytest.approx(result["objective"], abs=1e-6)


@pytest.mark.parametrize("model", [MECHANICAL, FIRST_ORDER], ids=["second order", "first order"])
def test_an_adaptive_mesh(model: dict[str, Any]) -> None:
    method = {"name": "swcm", "J": 2, "adaptive": {"tolerance": 1e-4}}
    result = result_of({**rest_to_rest(model), "method": method})
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(SHORTEST, abs=1e-3)


def test_a_rated_control_is_listed_as_state_and_as_control(rigid_body: dict[str, Any]) -> None:
    document = rest_to_rest(MECHANICAL)
    document["problem"]["outputs"] = [{"name": "jerk", "expression": "u_dot"}]
    result = result_of({**document, "method": {"name": "swcm"}})
    trajectory = result["trajectory"]
    assert list(trajectory["states"]) == ["x", "x_dot", "u"]
    assert list(trajectory["controls"]) == ["u", "u_dot"]
    assert trajectory["controls"]["u"] == trajectory["states"]["u"]
    assert trajectory["outputs"]["jerk"] == trajectory["controls"]["u_dot"]
    assert result["interpolation"] == {"u": "linear", "u_dot": "previous"}
    assert len(result["nodes"]["costates"]["u"]) == len(result["nodes"]["t"])
    pointers = [item["pointer"] for item in result["constraints"]]
    assert pointers == ["/problem/bounds/u", "/problem/control_rates/u", "/problem/final_time"]
    again = copy.deepcopy(document)
    again["problem"]["guess"] = {"from_result": result["nodes"]}
    assert result_of(again)["final_time"] == pytest.approx(SHORTEST, abs=1e-6)


def test_only_some_controls_are_rated(flexible_spacecraft: dict[str, Any]) -> None:
    """A second, unbounded actuator on the arms may jump; the torque of the hub may not."""
    problem = flexible_spacecraft["problem"]
    problem["model"]["controls"] = ["F", "T"]
    problem["model"]["input"] = [[0, 1], [1, 0]]
    problem["bounds"] |= {"F": [-1, 1]}
    problem["control_rates"] = {"T": [-5, 5]}
    problem["initial_control"] = {"T": 0}
    for method in ({"name": "swcm"}, {"name": "gpm"}, {"name": "hermite_simpson"}):
        spec = check_document({**flexible_spacecraft, "method": method})
        solution = solve(spec)
        result = solution.result()
        assert list(result["nodes"]["controls"]) == ["F", "T_dot"]
        assert result["trajectory"]["controls"]["T"][0] == pytest.approx(0, abs=1e-8)
        assert result["final_time"] < 26.9
        size = problem_size(spec)
        assert (size.variables, size.constraints) == (
            solution.statistics.variables,
            solution.statistics.constraints,
        )


def test_a_control_of_an_earlier_answer_starts_the_state() -> None:
    document = rest_to_rest(MECHANICAL)
    plain = copy.deepcopy(document)
    for key in ("control_rates", "initial_control", "final_control"):
        del plain["problem"][key]
    earlier = solve(check_document({**plain, "method": {"name": "swcm"}})).trajectory
    problem = stated_problem(check_document(document).problem)
    start = WarmStart(earlier, problem.guess, problem.states, problem.controls)
    tau = np.array([0.1, 0.9])
    assert start.states_at(tau)[2] == pytest.approx([1, -1])


@pytest.mark.parametrize("name", ["swcm", "gpm", "hermite_simpson"])
@each_model
def test_derivatives_of_the_program_are_exact(model: dict[str, Any], name: str) -> None:
    document = rest_to_rest(model)
    document["problem"]["objective"] = {"terminal": "tf*u_f", "running": "u_dot^2*x + t*u"}
    document["problem"]["path_constraints"] = [{"expression": "u_dot*u", "bounds": [-9, 9]}]
    program = transcribe(name, document).program()
    compiled = compile_program(program)
    w, p = (
        program.initial + 0.1 * np.random.default_rng(1).standard_normal(program.variables),
        program.numbers,
    )
    jacobian = np.asarray(compiled.jacobian(w, p)[1])
    for unit in np.eye(w.size) * 1e-5:
        ahead, behind = (program.values(w + s * unit)[1] for s in (1, -1))
        np.testing.assert_allclose(jacobian @ unit / 1e-5, (ahead - behind) / 2e-5, atol=1e-7, rtol=1e-6)


@pytest.mark.parametrize(
    ("rate", "method", "tolerance", "reference"),
    [
        # Hermite-Simpson with 1,200 intervals, by another program: 26.9124 and 31.0878.
        (5, {"name": "swcm", "refine": "switching"}, 5e-5, 26.9124),
        # At the slower rate the torque dips by 0.06 N m off its limit, which no node of this mesh sees.
        (1, {"name": "swcm", "refine": "switching"}, 5e-5, 31.0878),
    ],
)
def test_the_slew_with_a_bounded_torque_rate(
    flexible_spacecraft: dict[str, Any],
    rate: float,
    method: dict[str, Any],
    tolerance: float,
    reference: float,
) -> None:
    flexible_spacecraft["problem"] |= {
        "control_rates": {"T": [-rate, rate]},
        "initial_control": {"T": 0},
        "final_control": {"T": 0},
    }
    result = result_of({**flexible_spacecraft, "method": method})
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(reference, abs=tolerance)
    trajectory = Trajectory.from_result(result)
    tau = np.linspace(0, 1, 20_001)
    assert np.abs(np.diff(trajectory.states["T"](tau))).max() <= rate * trajectory.duration / 20_000 + 1e-9
    assert np.abs(trajectory.states["T"](tau)).max() <= 5 + 1e-7
