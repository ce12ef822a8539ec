"""Flights through phases and jumps against closed forms and SciPy."""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.solvers.conftest import INTEGRATOR
from tests.solvers.flights.test_flights import answer, flown
from tests.solvers.phases.test_phases import BOUNCE, GPM, SLIDE_AND_ROLL

Document = dict[str, Any]
Vector = NDArray[np.float64]


@pytest.fixture(scope="module")
def bounce() -> Document:
    """Falls from 1 to 0 in a second, hits at -1.8, rises in another one from 0.9 and rests at 1.

    The control is the straight line of least energy in each phase; mass and bounce are parameters.
    """
    document = copy.deepcopy(BOUNCE) | {"method": GPM, "output": {"command": {"period": 0.3, "delay": 0.07}}}
    problem = document["problem"]
    problem["model"] = {
        **problem["model"],
        "parameters": {"rho": 1, "m": "rho", "e": 0.5},
        "mass": [["m"]],
    }
    problem["bounds"] = {"x": [-0.05, 2]}
    problem["outputs"] = [{"name": "momentum", "expression": "m*x_dot"}]
    problem["integrals"] = [{"name": "push", "expression": "u/m", "bounds": [-2.8, None]}]
    problem["boundary_constraints"] = [{"expression": "m*(x_f - x_0)", "bounds": [-0.01, 0.01]}]
    problem["objective"]["terminal"] = "m - 1"
    problem["links"][0]["jump"]["x_dot"] = "-e*x_dot_f"
    return answer(document)


def test_peaks_cost_what_flights_reach(bounce: Document) -> None:
    """-x_dot is largest at the ground, 1.8/m, and counts over both phases; the speed going up does too.

    That is 0.9 + 2.4 s - 3.3 s^2, over m, as it is seen at 201 instants.
    """
    answered = copy.deepcopy(bounce)
    problem = answered["resolved"]["document"]["problem"]
    problem["objective"] = {"maximum": "-x_dot"}
    problem["phases"][1]["objective"] = {"maximum": "x_dot"}
    result = flown(answered, runs=20, parameters={"rho": {"uniform": [0.9, 1.1]}})
    m = np.array(result["columns"]["rho"])
    highest = 0.9 + 2.4**2 / (4 * 3.3)
    np.testing.assert_allclose(result["columns"]["objective"], (1.8 + highest) / m, atol=5e-5)


def force(t: float) -> float:
    """The control of the bounce."""
    if not 0 < t < 2:
        return 0.0
    return -2.4 + 1.2 * t if t < 1 else 2.4 - 6.6 * (t - 1)


def test_every_flight_jumps_where_it_comes_to(bounce: Document) -> None:
    asked: Document = {
        "parameters": {"rho": {"uniform": [0.9, 1.1]}, "e": {"normal": [0.5, 0.02]}},
        "initial_state": {"x": {"normal": [1, 0.01]}},
    }
    result = flown(bounce, runs=300, tolerance=1e-6, **asked)
    columns = {name: np.array(values) for name, values in result["columns"].items()}
    m, e, start = (columns[name] for name in ("rho", "e", "x_0"))
    ground = start - 1 / m
    np.testing.assert_allclose(columns["x_f"], ground + (1.8 * e + 0.1) / m, atol=1e-7)
    np.testing.assert_allclose(columns["x_dot_f"], (1.8 * e - 0.9) / m, atol=1e-7)
    np.testing.assert_allclose(columns["momentum_min"], -1.8, atol=1e-7)
    # What counts over the whole flight: the cost of the way, 7.8, and of the end.
    np.testing.assert_allclose(columns["objective"], 7.8 + m - 1, atol=1e-6)
    expected = {
        "/problem/phases/0/final_state/x": np.abs(ground),
        "/problem/bounds/x": np.maximum(-0.05 - ground, 0),
        "/problem/final_state/x_dot": np.abs(1.8 * e - 0.9) / m,
        "/problem/integrals/0": np.maximum(2.7 / m - 2.8, 0),
        "/problem/boundary_constraints/0": np.maximum(np.abs(m * (columns["x_f"] - start)) - 0.01, 0),
    }
    missed = {item["pointer"]: item for item in result["violations"]}
    assert missed.keys() == expected.keys() | {"/problem/final_state/x"}
    for pointer, excess in expected.items():
        np.testing.assert_allclose(columns[pointer], excess, atol=2e-7)
        assert 0 < missed[pointer]["rate"] == np.mean(columns[pointer] > missed[pointer]["tolerance"])
    worst = result["worst"][0]
    again = {key: {name: {"values": [value]} for name, value in worst[key].items()} for key in asked}
    assert flown(bounce, runs=1, **again)["columns"]["x_f"][0] == pytest.approx(worst["final"]["x"], abs=1e-9)


def test_an_actuator_lags_on_into_the_next_phase(bounce: Document) -> None:
    lag, delay = 0.2, 0.06

    def rate(t: float, y: Vector) -> list[float]:
        return [y[1], y[2], (force(t - delay) - y[2]) / lag]

    y = np.array([1.0, 0.0, 0.0])
    for start, stop in pairwise([0, delay, 1, 1 + delay, 2 + delay]):
        y = solve_ivp(rate, (start + 1e-13, stop - 1e-13), y, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        y[1] *= -0.5 if stop == 1 else 1.0
    result = flown(bounce, runs=1, actuator={"u": {"lag": lag, "delay": delay}}, coast=3)
    assert [result["final"][name]["nominal"] for name in ("x", "x_dot")] == pytest.approx(y[:2], abs=1e-8)
    assert result["final_time"] == pytest.approx(2 + delay)
    # Switched off it drifts.
    assert result["residual"]["x"]["nominal"] == pytest.approx(abs(y[1]) * 3 / 2, abs=1e-7)


def test_the_table_is_flown_through_the_jump(bounce: Document) -> None:
    """As it is told with the answer, where it is flown one by one."""
    result = flown(bounce, runs=1, use="command")
    told = bounce["command"]["verification"]
    assert result["final_time"] == pytest.approx(told["final_time"])
    for name, state in told["states"].items():
        assert result["final"][name]["nominal"] == pytest.approx(state["final"], abs=1e-9)


def test_what_only_one_phase_has() -> None:
    """y'' = F / M from rest over 1/13: the mass of the second model, and the control that is only there."""
    document = copy.deepcopy(SLIDE_AND_ROLL)
    model = document["problem"]["phases"][1]["model"]
    model |= {"parameters": {"M": 1}, "mass": [["M"]]}
    answered = answer(document)
    delayed: Document = {"actuator": {"F": {"delay": 0.1}}}
    result = flown(answered, runs=20, parameters={"M": {"uniform": [0.5, 2]}}, **delayed)
    columns = {name: np.array(values) for name, values in result["columns"].items()}
    np.testing.assert_allclose(columns["y_f"], 12 / 13 + 1 / 13 / columns["M"], atol=1e-7)
    np.testing.assert_allclose(columns["x_f"], 12 / 13, atol=1e-7)
    assert result["final_time"] == pytest.approx(2.1)


def test_a_drawn_parameter_counts_in_every_phase_that_has_it() -> None:
    """x' = a u, a = 1 and then 2, least integral of u^2 from 0 to 1: impulses 1/5 and 2/5."""
    document = {
        "problem": {
            "model": INTEGRATOR,
            "final_time": 1,
            "initial_state": {"x": 0},
            "final_state": {"x": 1},
            "objective": {"running": "u^2"},
            "phases": [{"name": "one", "final_time": 0.5}, {"name": "two", "parameters": {"a": 2}}],
        },
        "method": GPM,
    }
    answered = answer(document)
    assert flown(answered, runs=1)["final"]["x"]["nominal"] == pytest.approx(1, abs=1e-8)
    result = flown(answered, runs=1, parameters={"a": {"values": [3]}})
    assert result["final"]["x"]["max"] == pytest.approx(3 * 3 / 5, abs=1e-8)
