"""One command for several plants: closed forms, every plant flown, the slew that leaves none swinging."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from solvers.formulation.scenarios import formulate
from solvers.output.sampling import problem_of
from solvers.sizes import problem_size
from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory
from tests.solvers.output.test_outputs import METHODS, each_method, result_of

# x' = a u from 0, (x_f - 1)^2 + integral of u^2: with u = U, (a U - 1)^2 + U^2.
INTEGRATOR: dict[str, Any] = {
    "problem": {
        "model": {
            "kind": "first_order",
            "states": ["x"],
            "controls": ["u"],
            "parameters": {"a": 1, "twice": "2*a"},
            "dynamics": {"x": "twice*u/2"},
        },
        "final_time": 1,
        "initial_state": {"x": 0},
        "objective": {"terminal": "(x_f - 1)^2", "running": "u^2"},
        "scenarios": {"cases": [{"name": "strong", "parameters": {"a": 4}}]},
    }
}


each_search = pytest.mark.parametrize(
    "method",
    [*METHODS, {"name": "ga", "generations": 60, "population": 20, "scaling_functions": 2}],
    ids=lambda method: method["name"],
)


@each_search
@pytest.mark.parametrize(
    ("choice", "control", "objective", "weights"),
    [
        ("nominal", 0.5, 0.5, (1, 0)),
        ("mean", 5 / 19, ((14 / 19) ** 2 + (1 / 19) ** 2) / 2 + (5 / 19) ** 2, (1 / 2, 1 / 2)),
        # Where both plants cost the same: 1 - U = 4 U - 1; with these weights their sum is least there too.
        ("worst", 0.4, 0.52, (14 / 15, 1 / 15)),
    ],
)
def test_whose_objective_is_minimised(
    method: dict[str, Any], choice: str, control: float, objective: float, weights: tuple[float, float]
) -> None:
    document = copy.deepcopy(INTEGRATOR)
    document["problem"]["scenarios"]["objective"] = choice
    result = result_of({**document, "method": method})
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(objective, abs=1e-6)
    np.testing.assert_allclose(result["trajectory"]["controls"]["u"], control, atol=1e-4)
    assert list(result["scenarios"]) == ["nominal", "strong"]
    for name, gain in (("nominal", 1), ("strong", 4)):
        scenario = result["scenarios"][name]
        assert scenario["trajectory"]["states"]["x"][-1] == pytest.approx(gain * control, abs=1e-4)
        own = (gain * control - 1) ** 2 + control**2
        assert scenario["verification"]["objective"] == pytest.approx(own, abs=1e-4)
    assert result["trajectory"] == result["scenarios"]["nominal"]["trajectory"]
    assert result["design"] == {}
    if method["name"] == "ga":
        assert result["sensitivity"] is None
        return
    slopes = [
        weight * 2 * (gain * control - 1) * control for weight, gain in zip(weights, (1, 4), strict=True)
    ]
    places = ("model/parameters/a", "scenarios/cases/0/parameters/a")
    assert [result["sensitivity"][f"/problem/{place}"] for place in places] == pytest.approx(slopes, abs=1e-5)
    # It follows from a, which is another one in each plant: what it is worth is not one number.
    assert result["sensitivity"]["/problem/model/parameters/twice"] is None


def test_without_the_nominal_plant_the_first_case_leads() -> None:
    document = copy.deepcopy(INTEGRATOR)
    document["problem"]["scenarios"] |= {"nominal": False}
    document["problem"]["outputs"] = [{"name": "gain", "expression": "a*u"}]
    result = json.loads(json.dumps(result_of({**document, "method": {"name": "swcm"}})))
    assert list(result["scenarios"]) == ["strong"]
    # 4 U - 1 = -U/4
    assert result["trajectory"]["states"]["x"][-1] == pytest.approx(16 / 17, abs=1e-6)
    assert result["trajectory"]["outputs"]["gain"][5] == pytest.approx(16 / 17, abs=1e-6)
    assert problem_of(result).parameters == {"a": 4.0, "twice": 8.0}
    assert Trajectory.from_result(result).states["x"](np.ones(1))[0] == pytest.approx(16 / 17, abs=1e-6)


@each_method
def test_ends_and_bounds_of_one_case(method: dict[str, Any]) -> None:
    """x' = u to 1 and x' = 2 u to 2, as fast as speed 1 of the first and 1.5 of the second allow."""
    document = copy.deepcopy(INTEGRATOR)
    document["problem"] |= {
        "final_time": [0.1, 10],
        "final_state": {"x": 1},
        "bounds": {"u": [-1, 1]},
        "path_constraints": [{"expression": "a*u", "bounds": [-1.5, 1.5]}],
        "objective": {"terminal": "tf"},
    }
    document["problem"]["scenarios"] = {
        "cases": [
            {
                "name": "fast",
                "parameters": {"a": 2},
                "final_state": {"x": ["a", 2.5]},
                "bounds": {"x": [None, 3]},
            }
        ]
    }
    result = result_of({**document, "method": method})
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(4 / 3, abs=1e-5)
    assert result["scenarios"]["fast"]["trajectory"]["states"]["x"][-1] == pytest.approx(2, abs=1e-5)
    pointers = [item["pointer"] for item in result["scenarios"]["fast"]["constraints"]]
    case = "/problem/scenarios/cases/0"
    assert f"{case}/bounds/x" in pointers
    assert f"{case}/final_state/x" in pointers
    assert "/problem/final_time" in pointers


def test_a_command_of_two_plants_with_everything(flexible_spacecraft: dict[str, Any]) -> None:
    """Definitions, outputs, integrals, rates and design under two plants; what is common is there once."""
    problem = flexible_spacecraft["problem"]
    problem["model"]["definitions"] = {"moment": "2*k*alpha"}
    problem["model"]["stiffness"] = {"diag": [0, 0]}
    problem["model"]["force"] = [0, "-moment"]
    problem |= {
        "final_time": 40,
        "control_rates": {"T": [-5, 5]},
        "outputs": [{"name": "root", "expression": "moment"}],
        "integrals": [
            {"name": "work", "expression": "T*theta_dot"},
            {"name": "effort", "expression": "T^2", "bounds": [0, 900]},
        ],
        "path_constraints": [
            {"expression": "moment", "bounds": [-9, 9]},
            {"expression": "T*T_dot", "bounds": [-99, 99]},
        ],
        "boundary_constraints": [{"expression": "root_f + work", "bounds": [None, 99]}],
        "design": {"m": {"bounds": [9, 11]}},
        "objective": {"running": "T^2 + moment^2", "terminal": "m + work"},
        "scenarios": {"cases": [{"name": "soft", "parameters": {"k": 90}}], "objective": "worst"},
    }
    problem["final_state"] = {"theta": "pi/6", "theta_dot": 0}
    spec = check_document({**flexible_spacecraft, "method": {"name": "swcm", "J": 5}})
    solution, size = solve(spec), problem_size(spec)
    result = solution.result()
    assert result["status"] == "converged", result["message"]
    assert (size.variables, size.constraints) == (
        solution.statistics.variables,
        solution.statistics.constraints,
    )
    assert result["objective"] == pytest.approx(
        max(one["verification"]["objective"] for one in result["scenarios"].values()), rel=5e-3
    )
    assert list(result["integrals"]) == ["work", "effort"]
    assert list(result["design"]) == ["m"]
    for name, k in (("nominal", 100), ("soft", 90)):
        sampled = result["scenarios"][name]["trajectory"]
        assert list(sampled["states"]) == ["theta", "alpha", "theta_dot", "alpha_dot", "T"]
        np.testing.assert_allclose(sampled["outputs"]["root"], 2 * k * np.array(sampled["states"]["alpha"]))
    common = [item["trajectory"]["controls"] for item in result["scenarios"].values()]
    assert common[0] == common[1]


STIFFNESSES = np.array([100.0, 90.0, 110.0])


def test_the_slew_that_leaves_no_plant_swinging(flexible_spacecraft: dict[str, Any]) -> None:
    """k = 90, 100, 110 at rest, exactly, no method named; 21 plants in between swing by 2.5e-4 at most.

    Flown by equations written down here, all plants rest, but for the angle that the others turn farther or
    less by second order; and the gradient of t_f over the ten arcs is one of the ends that are asked for.
    """
    cases = [{"name": "soft", "parameters": {"k": 90}}, {"name": "stiff", "parameters": {"k": 110}}]
    document = {"problem": {**flexible_spacecraft["problem"], "scenarios": {"cases": cases}}}
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["method"]["refine"] == "switching"
    assert [item["code"] for item in result["warnings"]] == ["implied_ends"]
    lengths = np.diff([0.0, *result["switching"]["T"]["times"], result["final_time"]])
    assert lengths.size == 10
    # Only the way between both angles counts, and the time from the start; the bounds are alike.
    slopes = result["sensitivity"]
    assert slopes["/problem/final_state/theta"] > 1
    assert slopes["/problem/initial_state/theta"] == pytest.approx(
        -slopes["/problem/final_state/theta"], rel=1e-6
    )
    assert slopes["/problem/bounds/T/0"] == pytest.approx(-slopes["/problem/bounds/T/1"], rel=1e-4)
    assert slopes["/problem/initial_time"] == pytest.approx(1, abs=1e-6)
    ends = ends_of(lengths, STIFFNESSES)
    assert ends[[0, 1, 2, 3, 5, 7, 9, 11]] == pytest.approx([np.pi / 6] + [0] * 7, abs=1e-9)
    moved = [[ends_of(lengths + step, STIFFNESSES) for step in side * np.eye(10)] for side in (1e-4, -1e-4)]
    slopes = (np.array(moved[0]) - np.array(moved[1]))[:, [0, 1, 2, 3, 5, 7, 9, 11]] / 2e-4
    _, (left, *_), rank, _ = np.linalg.lstsq(slopes, np.ones(10), rcond=1e-9)
    assert rank == 8
    assert np.sqrt(left) <= 1e-5
    for name, number in (("soft", 1), ("stiff", 2)):
        flown = result["scenarios"][name]["verification"]
        checks = {check["name"]: check["value"] for check in flown["checks"]}
        off = abs(ends[4 * number] - np.pi / 6)
        assert flown["states"]["theta"]["terminal_error"] == pytest.approx(off, abs=1e-9)
        assert checks["terminal_error"] <= 1e-9 < checks["implied_ends"] <= 1e-5
    assert largest_swing(lengths, np.linspace(90, 110, 21)) <= 2.5e-4


def rate_of(flat: np.ndarray, torque: float, stiffnesses: np.ndarray) -> np.ndarray:
    """The hub with its arms, all plants side by side: theta, alpha, and their rates."""
    _, alpha, spin, flex = flat.reshape(4, -1)
    cos, sin = np.cos(alpha), np.sin(alpha)
    hub, arm, mixed = 440 + 20 * (31.25 + 25 * cos), 500.0, 20 * (25 + 12.5 * cos)
    first = torque + 250 * sin * (2 * spin + flex) * flex
    second = -250 * sin * spin**2 - 2 * stiffnesses * alpha
    det = hub * arm - mixed**2
    return np.concatenate(
        [spin, flex, (arm * first - mixed * second) / det, (hub * second - mixed * first) / det]
    )


def flown_by(lengths: np.ndarray, stiffnesses: np.ndarray) -> np.ndarray:
    """The state of all plants after arcs of 5 and -5 N m in turn, by plant."""
    state = np.zeros(4 * stiffnesses.size)
    for index, length in enumerate(lengths):
        torque = 5.0 - 10.0 * (index % 2)
        state = solve_ivp(
            lambda _, x, torque=torque: rate_of(x, torque, stiffnesses),
            (0, length),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-14,
        ).y[:, -1]
    return state


def ends_of(lengths: np.ndarray, stiffnesses: np.ndarray) -> np.ndarray:
    """theta, alpha, theta_dot, alpha_dot of the first plant, then of the others."""
    return flown_by(lengths, stiffnesses).reshape(4, -1).T.ravel()


def largest_swing(lengths: np.ndarray, stiffnesses: np.ndarray) -> float:
    """The largest deflection after the manoeuvre."""
    after = solve_ivp(
        lambda _, x: rate_of(x, 0.0, stiffnesses),
        (0, 40),
        flown_by(lengths, stiffnesses),
        method="DOP853",
        rtol=1e-9,
        atol=1e-11,
        max_step=0.1,
    )
    return float(np.abs(after.y[stiffnesses.size : 2 * stiffnesses.size]).max())


def test_ends_that_follow_from_others_are_found_and_no_more(flexible_spacecraft: dict[str, Any]) -> None:
    problem = flexible_spacecraft["problem"]
    problem |= {
        "control_rates": {"T": [-5, 5]},
        "initial_control": {"T": 0},
        "final_control": {"T": 0},
        "scenarios": {"cases": [{"name": "soft", "parameters": {"k": 90}}]},
    }
    flexible_spacecraft["method"] = {"name": "auto"}
    assert check_document(flexible_spacecraft).implied_tolerance() == 1e-2
    asked = flexible_spacecraft | {"options": {"verification": {"terminal_error": 1e-5}}}
    assert check_document(asked).implied_tolerance() == 1e-5
    (_, soft) = formulate(check_document(asked).problem, 1e-5).plants
    assert set(soft.implied.values()) == {1e-5}
    formulation = formulate(check_document(flexible_spacecraft).problem, 1e-2)
    assert formulation.implied == ("theta@soft", "theta_dot@soft")
    ends = dict(zip(formulation.problem.states, formulation.problem.final_state, strict=True))
    assert ends["T"] == (0.0, 0.0)
    assert ends["alpha@soft"] == (0.0, 0.0)
    assert ends["theta@nominal"] == (np.pi / 6, np.pi / 6)
    low, high = ends["theta@soft"]
    assert 0 < high - low < 2e-3
    # Where a plant may end as it will, nothing follows.
    problem["scenarios"]["cases"][0]["final_state"] = {"theta": None, "theta_dot": None}
    assert formulate(check_document(flexible_spacecraft).problem, 1e-2).implied == ()
    # What is held within an interval is held as it is said.
    problem["scenarios"]["cases"][0]["final_state"] = {"theta": [0.5235, 0.5237], "theta_dot": [-1e-7, 1e-7]}
    assert formulate(check_document(flexible_spacecraft).problem, 1e-2).implied == ()


def test_memory_and_work_grow_with_the_number_of_cases_only(flexible_spacecraft: dict[str, Any]) -> None:
    sizes = []
    for count in (1, 2, 4):
        cases = [{"name": f"c{i}", "parameters": {"k": 90 + i}} for i in range(count)]
        problem = {**flexible_spacecraft["problem"], "scenarios": {"cases": cases}}
        sizes.append(problem_size(check_document({"problem": problem, "method": {"name": "swcm"}})).variables)
    assert sizes[2] - sizes[1] == 2 * (sizes[1] - sizes[0])


@pytest.mark.parametrize("name", ["gpm", "hermite_simpson", "swcm"])
def test_refinement_of_a_command_of_two_plants(name: str, rigid_body: dict[str, Any]) -> None:
    """Two masses under one force: the light one arrives at 1 and rests, the heavy one is half as far."""
    free = {"x": None, "x_dot": None}
    cases = [{"name": "heavy", "parameters": {"m": 2}, "final_state": free}]
    document = {
        "problem": rigid_body["problem"] | {"scenarios": {"cases": cases}},
        "method": {"name": name, "refine": "switching"},
    }
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(2, abs=1e-9)
    assert result["switching"]["u"]["times"] == pytest.approx([1], abs=1e-8)
    heavy = result["scenarios"]["heavy"]["trajectory"]["states"]
    assert heavy["x"][-1] == pytest.approx(0.5, abs=1e-9)
