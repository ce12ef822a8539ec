"""Flights of phases: closed forms, single solves joined by hand, every phase flown through the jumps."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from solvers.output.export import to_csv
from solvers.output.plot import render
from solvers.output.sampling import resample
from solvers.phases.reading import phased_problem
from solvers.phases.trajectory import PhasedTrajectory, trajectory_of
from solvers.phases.verify import verify_phases
from solvers.sizes import problem_size
from solvers.spec import check_document
from solvers.verification.verdict import Tolerances
from tests.solvers.conftest import INTEGRATOR, OSCILLATOR, REGULATOR
from tests.solvers.formulation.test_data_tables import disturbed, least_energy
from tests.solvers.output.test_outputs import each_method, result_of

GPM = {"name": "gpm", "nodes": 24}

# x'' = u, minimise the integral of u^2.
DOUBLE_INTEGRATOR: dict[str, Any] = {
    "model": {"kind": "mechanical", "coordinates": ["x"], "controls": ["u"], "mass": [[1]], "input": [[1]]},
    "final_time": 2,
    "initial_state": {"x": 1, "x_dot": 0},
    "final_state": {"x": 1, "x_dot": 0},
    "objective": {"running": "u^2"},
}

# Falls from rest to the ground, loses half of its speed there, comes to rest where it was. Between two states
# the least integral is 12 D^2/T^3 - 12 D d/T^2 + 4 d^2/T with d = v1 - v0, D = x1 - x0 - v0 T; over both
# flights of one second 24 + 12 (1 + e) w + 4 (1 + e^2) w^2, least for w = -3 (1 + e)/(2 (1 + e^2)) at impact.
BOUNCE: dict[str, Any] = {
    "problem": {
        **DOUBLE_INTEGRATOR,
        "phases": [{"name": "down", "final_time": 1, "final_state": {"x": 0}}, {"name": "up"}],
        "links": [{"from": "down", "to": "up", "jump": {"x_dot": "-0.5*x_dot_f"}}],
    }
}

# A rocket against gravity and quadratic drag, with a stage that is dropped when its propellant is gone: when
# and where is chosen.
ROCKET: dict[str, Any] = {
    "problem": {
        "model": {
            "kind": "first_order",
            "states": ["h", "v", "m"],
            "controls": ["T"],
            "parameters": {"g": 1, "c": 2, "D": 0.1, "stage": 0.2},
            "dynamics": {"h": "v", "v": "(T - D*v^2)/m - g", "m": "-T/c"},
        },
        "final_time": 1.2,
        "initial_state": {"h": 0, "v": 0, "m": 1.5},
        "bounds": {"T": [-20, 20]},
        "objective": {"terminal": "-h_f", "running": "0.2*T^2"},
        "phases": [
            {"name": "boost", "final_time": [0.1, 1], "final_state": {"m": 1}},
            {"name": "climb", "bounds": {"T": [-10, 10]}, "final_state": {"m": 0.5}},
        ],
        "links": [{"from": "boost", "to": "climb", "jump": {"m": "m_f - stage"}}],
    },
    "method": GPM,
    "options": {"tolerance": 1e-11},
}

# x' = u for a second, then y'' = F with y beginning where x ended and at rest. The least integral of u^2 from
# x = 0 to x1 is x1^2, and 12 (1 - x1)^2 from rest to rest: x1 = 12/13.
SLIDE_AND_ROLL: dict[str, Any] = {
    "problem": {
        "model": {"kind": "first_order", "states": ["x"], "controls": ["u"], "dynamics": {"x": "u"}},
        "final_time": 2,
        "initial_state": {"x": 0},
        "objective": {"running": "u^2"},
        "phases": [
            {"name": "slide", "final_time": 1},
            {
                "name": "roll",
                "model": {
                    "kind": "mechanical",
                    "coordinates": ["y"],
                    "controls": ["F"],
                    "mass": [[1]],
                    "input": [[1]],
                },
                "initial_state": {"y_dot": 0},
                "final_state": {"y": 1, "y_dot": 0},
                "objective": {"running": "F^2"},
                "outputs": [{"name": "power", "expression": "F*y_dot"}],
            },
        ],
        "links": [{"from": "slide", "to": "roll", "jump": {"y": "x_f"}}],
    },
    "method": GPM,
}


@pytest.fixture(scope="module")
def rocket() -> dict[str, Any]:
    return json.loads(json.dumps(result_of(ROCKET)))


@each_method
@pytest.mark.parametrize("plain", [REGULATOR, OSCILLATOR], ids=["first order", "second order"])
def test_one_phase_is_the_problem_itself(method: dict[str, Any], plain: dict[str, Any]) -> None:
    document = {**copy.deepcopy(plain), "method": method}
    alone = result_of(document)
    document["problem"]["phases"] = [{"name": "all"}]
    phased = result_of(document)
    assert phased["objective"] == pytest.approx(alone["objective"], rel=1e-13)
    for key in ("states", "costates", "controls"):
        for name, values in alone["nodes"][key].items():
            np.testing.assert_allclose(phased["nodes"][key][name], values, atol=1e-12)
    assert phased["sensitivity"] == pytest.approx(alone["sensitivity"], abs=1e-9)
    assert phased["trajectory"]["t"] == alone["trajectory"]["t"]
    assert [phased["phases"][0][key] for key in ("name", "start", "stop")] == ["all", 0, 200]


@each_method
def test_a_bounce(method: dict[str, Any]) -> None:
    result = result_of({**BOUNCE, "method": method})
    assert result["success"], result["message"]
    impact = -3 * 1.5 / (2 * 1.25)
    objective = 24 + 12 * 1.5 * impact + 4 * 1.25 * impact**2
    assert objective == pytest.approx(7.8, abs=1e-12)
    assert result["objective"] == pytest.approx(objective, abs=1e-7)
    assert result["verification"]["objective"] == pytest.approx(objective, abs=1e-7)
    velocity, times = result["trajectory"]["states"]["x_dot"], result["trajectory"]["t"]
    down, up = result["phases"]
    assert (times[down["stop"]], times[up["start"]]) == (1.0, 1.0)
    assert velocity[down["stop"]] == pytest.approx(impact, abs=1e-7)
    assert velocity[up["start"]] == pytest.approx(-0.5 * impact, abs=1e-7)
    # At a jump lambda(-) = (d jump / d x)' lambda(+).
    costates, before, after = result["nodes"]["costates"]["x_dot"], down["nodes"][1], up["nodes"][0]
    assert costates[before] == pytest.approx(-0.5 * costates[after], abs=1e-4)


def test_a_dropped_mass_against_two_solves_joined_by_hand(rocket: dict[str, Any]) -> None:
    assert rocket["success"], rocket["message"]
    boost, climb = rocket["phases"]
    states = rocket["trajectory"]["states"]
    end, begin = (
        {name: values[phase] for name, values in states.items()} for phase in (boost["stop"], climb["start"])
    )
    assert begin["m"] == pytest.approx(end["m"] - 0.2, abs=1e-12)
    assert (begin["h"], begin["v"]) == pytest.approx((end["h"], end["v"]), abs=1e-12)
    alone = {key: value for key, value in ROCKET["problem"].items() if key not in ("phases", "links")}
    halves = [
        {**alone, "final_time": boost["tf"], "final_state": end, "objective": {"running": "0.2*T^2"}},
        {
            **alone,
            "initial_time": climb["t0"],
            "initial_state": begin,
            "final_state": {"m": 0.5},
            "bounds": {"T": [-10, 10]},
        },
    ]
    joined = [result_of({**ROCKET, "problem": half}) for half in halves]
    assert rocket["objective"] == pytest.approx(sum(half["objective"] for half in joined), abs=1e-8)


def test_where_the_stage_is_dropped_is_optimal(rocket: dict[str, Any]) -> None:
    """Earlier or later staging is worse, and the multiplier of a fixed time says by how much."""
    boost = rocket["phases"][0]
    objectives = []
    for change in (-0.02, 0.02):
        document = copy.deepcopy(ROCKET)
        document["problem"]["phases"][0]["final_time"] = boost["tf"] + change
        moved = result_of(document)
        objectives.append(moved["objective"] - rocket["objective"])
        slope = moved["sensitivity"]["/problem/phases/0/final_time"]
        # A parabola about the optimum: its slope is twice the rise over the way.
        assert slope == pytest.approx(2 * objectives[-1] / change, rel=0.05)
    assert min(objectives) > 0


def test_sensitivities_are_those_of_solving_again(rocket: dict[str, Any]) -> None:
    for pointer, keys in (
        ("/problem/model/parameters/stage", ("model", "parameters", "stage")),
        ("/problem/initial_state/m", ("initial_state", "m")),
    ):
        found = []
        for change in (-1e-4, 1e-4):
            document = copy.deepcopy(ROCKET)
            node = document["problem"]
            for key in keys[:-1]:
                node = node[key]
            node[keys[-1]] += change
            found.append(result_of(document)["objective"])
        assert rocket["sensitivity"][pointer] == pytest.approx((found[1] - found[0]) / 2e-4, rel=1e-4), (
            pointer
        )


def test_the_whole_flight_is_flown_through_the_jump(rocket: dict[str, Any]) -> None:
    problem = phased_problem(check_document(ROCKET).problem)
    answer = PhasedTrajectory.from_result(rocket)
    again = verify_phases(problem, answer, Tolerances(), float("inf"))
    assert again.terminal_error == pytest.approx(rocket["verification"]["terminal_error"], abs=1e-10)
    # Another mass than promised is dropped: the second phase is then flown from there, and misses.
    other = copy.deepcopy(ROCKET)
    other["problem"]["links"][0]["jump"]["m"] = "m_f - stage - 0.01"
    missed = verify_phases(phased_problem(check_document(other).problem), answer, Tolerances(), float("inf"))
    checks = {check.name: check.value for check in missed.checks}
    assert missed.parts[1].states["m"].terminal_error == pytest.approx(0.01, rel=1e-3)
    assert checks["link"] == pytest.approx(0.01 / 0.8, rel=1e-6)
    assert missed.states["m"].max_error == pytest.approx(again.states["m"].max_error)


def test_a_stored_flight_is_resampled_exactly(rocket: dict[str, Any]) -> None:
    curves = trajectory_of(rocket)
    times = np.array(rocket["trajectory"]["t"])
    again = resample(rocket, curves, times, derivatives=True)
    for group in ("states", "controls", "outputs"):
        assert again[group] == rocket["trajectory"][group]
    inner = rocket["phases"][0]["tf"]
    alone = resample(rocket, curves, np.array([inner]))
    both = resample(rocket, curves, np.array([inner, inner]))
    assert both["states"]["m"][0] - 0.2 == pytest.approx(both["states"]["m"][1], abs=1e-12)
    assert alone["states"]["m"] == both["states"]["m"][1:]
    assert to_csv(rocket).count("\n") == len(times) + 1
    assert render(rocket, "svg").startswith(b"<?xml")


def test_what_the_result_says_of_phases(rocket: dict[str, Any]) -> None:
    pointers = [item["pointer"] for item in rocket["constraints"]]
    assert pointers == ["/problem/bounds/T", "/problem/phases/0/final_time", "/problem/phases/1/bounds/T"]
    size = problem_size(check_document(ROCKET))
    assert (size.variables, size.constraints) == (
        rocket["statistics"]["variables"],
        rocket["statistics"]["constraints"],
    )
    assert [item["name"] for item in rocket["phases"]] == ["boost", "climb"]
    assert all(item["verification"]["passed"] for item in rocket["phases"])
    assert rocket["verification"]["hamiltonian_drift"] < 1e-5
    assert rocket["model_report"].keys() == {"initial", "final"}
    boost = rocket["phases"][0]
    assert rocket["trajectory"]["t"][boost["stop"]] == boost["tf"]
    switches = rocket["switching"]["T"]
    assert len(switches["levels"]) == len(switches["arcs"]) == len(switches["times"]) + 1


def test_phases_with_models_of_their_own() -> None:
    result = result_of(SLIDE_AND_ROLL)
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(12 / 13, abs=1e-10)
    trajectory, (slide, roll) = result["trajectory"], result["phases"]
    assert set(trajectory["states"]) == {"x", "y", "y_dot"}
    assert trajectory["states"]["y"][roll["start"]] == pytest.approx(12 / 13, abs=1e-9)
    for name, phase in (("y", slide), ("x", roll), ("power", slide)):
        group = "outputs" if name == "power" else "states"
        assert set(trajectory[group][name][phase["start"] : phase["stop"] + 1]) == {None}
    json.dumps(result, allow_nan=False)


@pytest.mark.parametrize("kind", ["linear", "previous"])
def test_tables_are_met_at_their_corners_in_every_phase(kind: str) -> None:
    """Two phases that go on where the other ends are one flight, whose least energy is known."""
    document = disturbed(kind, name="gpm", nodes=20)
    document["problem"]["phases"] = [{"name": "first", "final_time": 0.5}, {"name": "second"}]
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(least_energy(kind), abs=1e-10)
    assert result["verification"]["objective"] == pytest.approx(least_energy(kind), abs=1e-10)
    size = problem_size(check_document(document))
    assert (size.variables, size.constraints) == (
        result["statistics"]["variables"],
        result["statistics"]["constraints"],
    )
    assert result["warnings"] == []
    document["problem"]["phases"][0]["final_time"] = [0.4, 0.6]
    warnings = phased_problem(check_document(document).problem).warnings
    assert [(item["code"], item["pointer"]) for item in warnings] == [
        ("table_corners_off_mesh", "/problem/data/Td")
    ]


@pytest.mark.parametrize(
    ("kind", "method"),
    [
        ("previous", GPM),
        ("linear", {"name": "hermite_simpson", "intervals": 12}),
        ("previous", {"name": "swcm", "J": 2}),
    ],
)
def test_a_corner_is_met_where_a_phase_ends_though_the_final_time_is_free(
    kind: str, method: dict[str, Any]
) -> None:
    """Least energy over T is 12 D^2/T^3 - 12 D d/T^2 + 4 d^2/T, with what a table does by itself; and 3 T."""
    x, values = [0, 0.45, 3], [0, 2, -1]
    document = disturbed(kind, **method)
    problem = document["problem"]
    problem["data"]["Td"] |= {"x": x, "values": values}
    problem |= {"final_time": [0.5, 3], "objective": {"running": "u^2 + 3"}}
    problem["phases"] = [{"name": "before", "final_time": 0.45}, {"name": "on"}]

    def push(t: float) -> float:
        return float(np.interp(t, x, values)) if kind == "linear" else 2.0 * (t >= 0.45)

    def cost(time: float) -> float:
        speed = quad(push, 0, time, points=[0.45])[0]
        way = 1 - quad(lambda t: (time - t) * push(t), 0, time, points=[0.45])[0]
        return 12 * way**2 / time**3 + 12 * way * speed / time**2 + 4 * speed**2 / time + 3 * time

    best = minimize_scalar(cost, (1, 2, 3), options={"xtol": 1e-12})
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(best.x, abs=1e-5)
    assert result["objective"] == pytest.approx(best.fun, abs=1e-7)
    assert result["warnings"] == []


def test_what_counts_over_the_whole_flight() -> None:
    """Integrals add up over phases, a design parameter is one, boundary constraints join both ends.

    x' = a u from 0 to 1 by way of any state with integral of u over the flight 2, so a = 1/2; u = 1.
    """
    document = {
        "problem": {
            "model": INTEGRATOR,
            "final_time": 2,
            "initial_state": {"x": None},
            "boundary_constraints": [{"expression": "x_f - x_0 - 1", "bounds": 0}],
            "integrals": [{"name": "effort", "expression": "u", "bounds": 2}],
            "design": {"a": {"bounds": [0.1, 2]}},
            "objective": {"running": "u^2", "terminal": "x_0^2 + 3*effort + a"},
            "phases": [{"name": "one", "final_time": 0.5}, {"name": "two"}],
        },
        "method": {"name": "hermite_simpson", "intervals": 8},
    }
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["design"]["a"] == pytest.approx(0.5, abs=1e-8)
    margins = {item["pointer"]: item["margin"] for item in result["constraints"]}
    assert margins == pytest.approx(
        {"/problem/boundary_constraints/0": 0.0, "/problem/integrals/0": 0.0, "/problem/design/a": 0.4},
        abs=1e-8,
    )
    assert result["integrals"]["effort"] == pytest.approx(2, abs=1e-8)
    assert [phase["integrals"]["effort"] for phase in result["phases"]] == pytest.approx([0.5, 1.5], abs=1e-6)
    assert result["objective"] == pytest.approx(2 + 6 + 0.5, abs=1e-8)
    assert result["verification"]["objective"] == pytest.approx(8.5, abs=1e-7)


def test_slacks_of_a_phase_are_its_own_affair() -> None:
    """Fuel |u| from 0 by way of 0.3 at half time back to 0: 0.6, whatever else counts over the flight."""
    document = {
        "problem": {
            "model": INTEGRATOR,
            "final_time": 1,
            "initial_state": {"x": 0},
            "final_state": {"x": 0},
            "bounds": {"u": [-1, 1]},
            "boundary_constraints": [{"expression": "x_0 + x_f + u_0", "bounds": [-1, 1]}],
            "objective": {"running": "abs(u)", "terminal": "x_f"},
            "phases": [{"name": "there", "final_time": 0.5, "final_state": {"x": 0.3}}, {"name": "back"}],
        },
        "method": {"name": "hermite_simpson", "intervals": 8},
    }
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(0.6, abs=1e-6)
    assert result["verification"]["objective"] == pytest.approx(0.6, abs=1e-6)


def test_more_nodes_converge_spectrally() -> None:
    """The regulator whose state drops by 0.3 at a free time: closed forms on both sides of the jump."""
    document = copy.deepcopy(REGULATOR)
    document["problem"]["phases"] = [
        {"name": "one", "final_time": 0.4, "final_state": {"x": 0.9}},
        {"name": "two"},
    ]
    document["problem"]["links"] = [{"from": "one", "to": "two", "jump": {"x": "x_f - 0.3"}}]
    exact = ((1 + 0.81) * np.cosh(0.4) - 1.8) / (2 * np.sinh(0.4)) + 0.36 * np.tanh(0.6) / 2
    errors = []
    for nodes in (1, 2, 3):
        result = result_of({**document, "method": {"name": "gpm", "nodes": nodes}})
        errors.append(abs(result["objective"] - exact))
    assert errors[1] < 0.02 * errors[0]
    assert errors[2] < 0.02 * errors[1]
