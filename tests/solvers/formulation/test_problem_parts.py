"""Integrals, design parameters, windows and control ends, against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory
from tests.solvers.output.test_outputs import each_method, result_of


@each_method
def test_the_shortest_time_with_a_given_energy(rigid_body: dict[str, Any], method: dict[str, Any]) -> None:
    """The integral of u^2 for a rest-to-rest move over 1 in time T is 12/T^3 at least: 12 gives T = 1."""
    problem = rigid_body["problem"]
    problem["bounds"] = {}
    problem["integrals"] = [{"name": "energy", "expression": "u^2", "bounds": [None, 12]}]
    result = result_of({**rigid_body, "method": method})
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(1.0, abs=1e-6)
    assert result["integrals"]["energy"] == pytest.approx(12.0, abs=1e-6)
    assert result["verification"]["integrals"]["energy"] == pytest.approx(12.0, abs=2e-2)
    (margin,) = [item for item in result["constraints"] if item["pointer"] == "/problem/integrals/0"]
    assert (margin["name"], margin["at"]) == ("energy", result["final_time"])
    assert margin["max"] == pytest.approx(12.0, abs=1e-6)
    assert margin["margin"] == pytest.approx(0.0, abs=1e-6)
    assert margin["active"]
    # The Hamiltonian of the whole problem, with the multiplier of the integral, is constant.
    assert result["verification"]["hamiltonian_drift"] < 1e-3


def test_what_is_said_of_the_ends_has_margins(rigid_body: dict[str, Any]) -> None:
    """The end may lie between 1 and 3, so it is 1 in the time 2; x_f + v_f^2 <= 5 has room for 4."""
    problem = rigid_body["problem"]
    problem["final_state"] = {"*": [1, 3], "x_dot": 0}
    problem["boundary_constraints"] = [
        {"name": "room", "expression": "x_f + x_dot_f^2 + x_0", "bounds": [None, 5]}
    ]
    result = result_of({**rigid_body, "method": {"name": "swcm", "refine": "switching"}})
    margins = {item["name"]: item for item in result["constraints"]}
    assert margins.keys() == {"u", "x_f", "tf", "room"}
    assert margins["x_f"]["pointer"] == "/problem/final_state/*"
    assert margins["tf"]["pointer"] == "/problem/final_time"
    assert margins["tf"]["max"] == pytest.approx(2.0, abs=1e-9)
    assert margins["x_f"]["margin"] == pytest.approx(0.0, abs=1e-9)
    assert margins["room"]["margin"] == pytest.approx(4.0, abs=1e-9)
    assert margins["room"]["at"] == pytest.approx(2.0, abs=1e-9)
    assert margins["room"]["active"] == []


@each_method
def test_an_integral_in_the_terminal_cost(rigid_body: dict[str, Any], method: dict[str, Any]) -> None:
    """T + 12/(36 T^3) is smallest at T = 1: 4/3."""
    problem = rigid_body["problem"]
    problem["bounds"] = {}
    problem["integrals"] = [{"name": "energy", "expression": "u^2"}]
    problem["objective"] = {"terminal": "tf + energy/36"}
    result = result_of({**rigid_body, "method": method})
    assert result["objective"] == pytest.approx(4 / 3, abs=1e-6)
    assert result["verification"]["objective"] == pytest.approx(4 / 3, abs=1e-3)


def test_an_integral_that_what_is_flown_does_not_keep_fails_the_check(rigid_body: dict[str, Any]) -> None:
    """On three intervals the program sees another value than the flight of its control has."""
    problem = rigid_body["problem"]
    problem["integrals"] = [{"name": "rough", "expression": "exp(9*x_dot)", "bounds": [950, 1000]}]
    document = {**rigid_body, "method": {"name": "hermite_simpson", "intervals": 3}}
    document["options"] = {"verification": {"state_error": 10, "bound": 10, "terminal_error": 1e-9}}
    result = result_of(document)
    ends = next(check for check in result["verification"]["checks"] if check["name"] == "ends")
    assert result["integrals"]["rough"] >= 949
    assert result["verification"]["integrals"]["rough"] < 940
    assert not ends["passed"]
    assert not result["success"]


@each_method
@pytest.mark.parametrize(
    ("parameters", "design", "terminal", "value", "objective"),
    [
        ({"m": 3}, "m", "tf + 1/m", 1.0, 3.0),
        ({"a": 1, "m": "a^2"}, "a", "tf + 1/sqrt(m)", np.sqrt(0.5), 2 * np.sqrt(2)),
    ],
    ids=["a parameter", "one that follows from it"],
)
@pytest.mark.parametrize("refine", [None, "switching"])
def test_design_parameters(
    rigid_body: dict[str, Any],
    method: dict[str, Any],
    refine: str | None,
    parameters: dict[str, Any],
    design: str,
    terminal: str,
    value: float,
    objective: float,
) -> None:
    """A mass m moves over 1 in 2 sqrt(m) at best."""
    problem = rigid_body["problem"]
    problem["model"]["parameters"] = parameters
    problem["design"] = {design: {"bounds": [0.2, 4]}}
    problem["objective"] = {"terminal": terminal}
    result = result_of({**rigid_body, "method": {**method, "refine": refine}})
    assert result["success"] or refine is None, result["message"]
    tolerance = 5e-3 if refine is None else 1e-7
    assert result["objective"] == pytest.approx(objective, abs=tolerance)
    assert result["design"][design] == pytest.approx(value, abs=2 * tolerance**0.8)
    assert Trajectory.from_result(result).design == result["design"]


def test_a_design_parameter_starts_from_its_guess_and_stays_in_its_bounds(rigid_body: dict[str, Any]) -> None:
    rigid_body["problem"]["design"] = {"m": {"bounds": [2, 3], "guess": 2.5}}
    result = result_of({**rigid_body, "method": {"name": "swcm"}})
    assert result["design"]["m"] == pytest.approx(2.0, abs=1e-6)
    assert result["final_time"] == pytest.approx(2 * np.sqrt(2), abs=1e-3)


@each_method
def test_a_constraint_that_holds_for_the_first_half(
    rigid_body: dict[str, Any], method: dict[str, Any]
) -> None:
    """Speed 1/4 at most until half of the time h has passed, then up to b = (h + 1/4)/2 and down to rest.

    Ways 1/32 + (h - 1/4)/4 and b^2 - 1/32 add up to 1.
    """
    h = (-0.375 + np.sqrt(0.375**2 + 1 + 3 / 64)) / 0.5
    problem = rigid_body["problem"]
    problem["path_constraints"] = [
        {"name": "slow", "expression": "x_dot", "bounds": [None, 0.25], "during": [0, 0.5]}
    ]
    if method["name"] == "gpm":
        method = {**method, "segments": 4, "nodes": 12}
    result = result_of({**rigid_body, "method": method})
    # Gauss nodes stop short of the middle, where the speed begins to grow.
    assert result["final_time"] == pytest.approx(2 * h, abs=1e-2 if method["name"] == "gpm" else 5e-3)
    (slow,) = [item for item in result["constraints"] if item["pointer"] == "/problem/path_constraints/0"]
    assert slow["max"] == pytest.approx(0.25, abs=2e-2)
    speeds = np.array(result["trajectory"]["states"]["x_dot"])
    assert speeds.max() > 0.8


@each_method
def test_controls_with_given_ends(oscillator: dict[str, Any], method: dict[str, Any]) -> None:
    problem = oscillator["problem"]
    problem["initial_control"], problem["final_control"] = {"u": 0}, {"u": [-0.25, 0.25]}
    result = result_of({**oscillator, "method": method})
    controls = result["trajectory"]["controls"]["u"]
    assert controls[0] == pytest.approx(0.0, abs=1e-8)
    assert abs(controls[-1]) <= 0.25 + 1e-8
    plain = {key: value for key, value in problem.items() if not key.endswith("_control")}
    free = result_of({"problem": plain, "method": method})
    assert result["objective"] > free["objective"]


def test_auto_looks_for_no_arcs_where_a_control_has_given_ends(rigid_body: dict[str, Any]) -> None:
    rigid_body["problem"]["initial_control"] = {"u": 0}
    rigid_body["method"] = {"name": "auto", "accuracy": 1e-3}
    result = solve(check_document(rigid_body)).result()
    assert "adaptive" in result["method"]
    assert "refine" not in result["method"]
    assert result["trajectory"]["controls"]["u"][0] == 0.0


@each_method
def test_adaptive_meshes_with_integrals_and_design(
    rigid_body: dict[str, Any], method: dict[str, Any]
) -> None:
    """The force u/m over time T costs 12 m^2/T^3: with T + energy/36 + 1/m, T = sqrt(m) at best."""
    problem = rigid_body["problem"]
    problem["bounds"] = {}
    problem["integrals"] = [{"name": "energy", "expression": "u^2"}]
    problem["design"] = {"m": {"bounds": [0.1, 10]}}
    problem["objective"] = {"terminal": "tf + energy/36 + 1/m"}
    result = result_of({**rigid_body, "method": {**method, "adaptive": {"tolerance": 1e-6}}})
    # J = (4/3) sqrt(m) + 1/m
    best = 1.5 ** (2 / 3)
    assert result["success"], result["message"]
    assert result["design"]["m"] == pytest.approx(best, rel=1e-3)
    assert result["objective"] == pytest.approx(4 / 3 * np.sqrt(best) + 1 / best, abs=1e-6)
