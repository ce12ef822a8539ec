"""Definitions, outputs, accelerations and vibration energy in solved problems, against what is known."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from solvers.output.export import columns
from solvers.output.sampling import problem_of, sample
from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory

METHODS = (
    {"name": "swcm"},
    {"name": "gpm", "nodes": 24},
    {"name": "hermite_simpson"},
)
each_method = pytest.mark.parametrize("method", METHODS, ids=lambda method: method["name"])


def result_of(document: dict[str, Any]) -> dict[str, Any]:
    """The result, whose program converged; a jump between nodes need not be verified on so few of them."""
    result = solve(check_document(document)).result()
    assert result["statistics"]["nlp_status"] == "Solve_Succeeded", result["message"]
    return result


@each_method
def test_definitions_and_forms_of_matrices_change_nothing(
    flexible_spacecraft: dict[str, Any], method: dict[str, Any]
) -> None:
    plain = result_of({**flexible_spacecraft, "method": method})
    document = copy.deepcopy(flexible_spacecraft)
    model = document["problem"]["model"]
    model["definitions"] = {
        "c": "cos(alpha)",
        "s": "sin(alpha)",
        "h": "2*m*R*L",
        "g": "2*m*L^2 + h*c",
        "w": "h*s",
    }
    model["mass"] = {
        "entries": [[0, 0, "Jb + 2*m*R^2 + g + h*c"], [0, 1, "g"], [1, 1, "2*m*L^2"]],
        "symmetric": True,
    }
    model["damping"] = [["-w*alpha_dot", "-w*(theta_dot + alpha_dot)"], ["w*theta_dot", 0]]
    model["stiffness"] = {"diag": [0, "2*k"]}
    model["input"] = {"entries": [[0, 0, 1]]}
    defined = result_of({**document, "method": method})
    assert defined["final_time"] == pytest.approx(plain["final_time"], abs=1e-9)


@each_method
def test_outputs_are_sampled_with_their_extremes(
    flexible_spacecraft: dict[str, Any], method: dict[str, Any]
) -> None:
    problem = flexible_spacecraft["problem"]
    problem["outputs"] = [
        {"name": "root_moment", "expression": "2*k*alpha", "units": "N m"},
        {"name": "hub_acceleration", "expression": "theta_ddot"},
        {"name": "momentum", "expression": "(Jb + 2*m*(R^2 + L^2 + 2*R*L*cos(alpha)))*theta_dot"},
    ]
    problem["model"]["flexible"] = ["alpha"]
    result = result_of({**flexible_spacecraft, "method": method})
    trajectory = {
        group: {name: np.array(values) for name, values in result["trajectory"][group].items()}
        for group in ("states", "controls", "outputs")
    }
    states, outputs = trajectory["states"], trajectory["outputs"]
    assert list(outputs) == ["root_moment", "hub_acceleration", "momentum", "vibration_energy"]
    np.testing.assert_allclose(outputs["root_moment"], 200.0 * states["alpha"], rtol=1e-14)
    # Two tip masses of 10 kg on arms of 5 m, two springs of 100 N m/rad.
    energy = 0.5 * (500.0 * states["alpha_dot"] ** 2 + 200.0 * states["alpha"] ** 2)
    np.testing.assert_allclose(outputs["vibration_energy"], energy, rtol=1e-12, atol=1e-18)
    # Lagrange's equation of the arms, solved by hand for the acceleration of the hub.
    cos, sin = np.cos(states["alpha"]), np.sin(states["alpha"])
    hub, arm, coupling = 440 + 20 * (31.25 + 25 * cos), 500.0, 20 * (25 + 12.5 * cos)
    spin, flex = states["theta_dot"], states["alpha_dot"]
    loads = trajectory["controls"]["T"] + 250 * sin * (flex * spin + (spin + flex) * flex)
    arm_loads = -250 * sin * spin**2 - 200 * states["alpha"]
    expected = (loads - coupling / arm * arm_loads) / (hub - coupling**2 / arm)
    np.testing.assert_allclose(outputs["hub_acceleration"], expected, rtol=1e-10, atol=1e-14)
    extremes = {item["name"]: item for item in result["outputs"]}
    assert extremes["root_moment"]["units"] == "N m"
    for name, values in outputs.items():
        assert extremes[name]["min"] <= values.min()
        assert extremes[name]["max"] >= values.max()
        assert extremes[name]["max"] == pytest.approx(values.max(), rel=0.05)
    assert list(columns(result["trajectory"]))[-4:] == list(outputs)


def test_outputs_of_a_stored_result_at_other_times(flexible_spacecraft: dict[str, Any]) -> None:
    flexible_spacecraft["problem"]["outputs"] = [{"name": "twice", "expression": "2*theta + 0*t"}]
    stored = result_of({**flexible_spacecraft, "method": {"name": "swcm", "J": 2}})
    times = np.array([0.0, 1.0, 20.0])
    sampled = sample(problem_of(stored), Trajectory.from_result(stored), times)
    np.testing.assert_allclose(sampled["outputs"]["twice"], 2 * np.array(sampled["states"]["theta"]))


@each_method
@pytest.mark.parametrize("refine", [None, "switching"])
def test_a_bound_on_an_acceleration(
    rigid_body: dict[str, Any], method: dict[str, Any], refine: str | None
) -> None:
    """m = 1, |u| <= 1, |x''| <= 1/2: from rest to rest over 1 in 2 sqrt(2)."""
    rigid_body["problem"]["path_constraints"] = [{"expression": "x_ddot", "bounds": [-0.5, 0.5]}]
    result = result_of({**rigid_body, "method": {**method, "refine": refine}})
    assert result["success"] or refine is None, result["message"]
    tolerance = 1e-2 if refine is None else 1e-9
    assert result["final_time"] == pytest.approx(2 * np.sqrt(2), abs=tolerance)


@each_method
def test_an_acceleration_in_the_running_cost(oscillator: dict[str, Any], method: dict[str, Any]) -> None:
    """x'' + x = u: the cost of (x'' + x)^2/2 is that of u^2/2."""
    document = {**oscillator, "method": method}
    plain = result_of(document)
    document["problem"]["objective"]["running"] = "(x_ddot + x)^2/2"
    assert result_of(document)["objective"] == pytest.approx(plain["objective"], rel=1e-9)


@each_method
def test_an_output_at_the_end_in_boundary_and_objective(
    rigid_body: dict[str, Any], method: dict[str, Any]
) -> None:
    """As far as possible in time 2 with u <= 1 and kinetic energy 1/2 at the end: x = 7/4.

    Full force up to the speed 3/2, then braking to 1: 9/8 + 5/8.
    """
    problem = rigid_body["problem"]
    problem |= {
        "final_time": 2,
        "final_state": {},
        "outputs": [{"name": "energy", "expression": "m*x_dot^2/2"}, {"name": "way", "expression": "x"}],
        "boundary_constraints": [{"name": "energy", "expression": "energy_f", "bounds": 0.5}],
        "objective": {"terminal": "-way_f"},
    }
    problem["guess"] = {"states": {"x_dot": [0, 1]}}
    result = result_of({**rigid_body, "method": {**method, "refine": "switching"}})
    assert result["objective"] == pytest.approx(-7 / 4, abs=1e-8)
    assert result["trajectory"]["outputs"]["energy"][-1] == pytest.approx(0.5, abs=1e-9)
