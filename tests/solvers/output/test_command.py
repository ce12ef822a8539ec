"""The command as a table: exact means, its flight, quantum and delay, and coasting afterwards."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.io import loadmat

from solvers.output.export import command_csv, command_mat
from solvers.trajectory import Trajectory
from tests.solvers.output.test_outputs import each_method, result_of

SLEW = {"name": "swcm", "refine": "switching"}


@pytest.fixture
def slew(flexible_spacecraft: dict[str, Any]) -> dict[str, Any]:
    flexible_spacecraft["problem"]["model"]["flexible"] = ["alpha"]
    return {**flexible_spacecraft, "method": SLEW}


def test_averages_at_a_tenth_of_a_second_miss_by_little(slew: dict[str, Any]) -> None:
    slew["output"] = {"command": {"period": 0.1}}
    command = result_of(slew)["command"]
    assert len(command["t"]) == 259
    np.testing.assert_allclose(np.diff(command["t"]), 0.1, rtol=1e-9)
    assert np.abs(command["controls"]["T"]).max() <= 5
    states = command["verification"]["states"]
    assert max(abs(state["error"]) for state in states.values()) <= 5e-5
    assert command["verification"]["final_time"] == pytest.approx(25.9)
    assert command["verification"]["terminal_error"] < 1e-3


def test_samples_miss_by_far_more(slew: dict[str, Any]) -> None:
    """Measured elsewhere: 5.2e-3 rad."""
    slew["output"] = {"command": {"period": 0.1, "rule": "sample"}}
    states = result_of(slew)["command"]["verification"]["states"]
    assert states["theta"]["error"] == pytest.approx(5.2e-3, abs=3e-4)


@each_method
def test_averages_are_exact_means(oscillator: dict[str, Any], method: dict[str, Any]) -> None:
    oscillator["output"] = {"command": {"period": 0.3}}
    result = result_of({**oscillator, "method": method})
    command, answer = result["command"], Trajectory.from_result(result)
    assert command["t"] == pytest.approx([0, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8])
    for start, mean in zip(command["t"], command["controls"]["u"], strict=True):
        ends = answer.tau(np.array([start, start + 0.3]))
        inner = answer.breakpoints[(answer.breakpoints > ends[0]) & (answer.breakpoints < ends[1])]
        integral, _ = quad(
            lambda tau: float(answer.controls["u"](np.array([tau]))[0]), *ends, points=inner, limit=400
        )
        assert mean == pytest.approx(integral * answer.duration / 0.3, rel=1e-10)


def test_a_table_is_played_as_it_stands(rigid_body: dict[str, Any]) -> None:
    """u = 1 for 1 s, then -1: with a period of 0.5 s and a delay of 0.25 s the same way, a little later."""
    rigid_body["output"] = {"command": {"period": 0.5, "delay": 0.25, "rule": "sample"}, "coast": 3}
    result = result_of({**rigid_body, "method": SLEW})
    command = result["command"]
    assert command["controls"]["u"] == pytest.approx([1, 1, -1, -1])
    flight = command["verification"]
    assert flight["final_time"] == pytest.approx(2.25)
    assert flight["states"]["x"]["final"] == pytest.approx(1, abs=1e-9)
    assert flight["states"]["x_dot"]["error"] == pytest.approx(0, abs=1e-9)
    assert flight["coast"]["t"][0] == pytest.approx(2.25)


def test_a_quantum_rounds_within_the_bounds(slew: dict[str, Any]) -> None:
    slew["output"] = {"command": {"period": 0.5, "quantum": {"T": 0.3}}}
    values = np.array(result_of(slew)["command"]["controls"]["T"])
    np.testing.assert_allclose(values / 0.3, np.round(values / 0.3), atol=1e-9)
    assert values.max() == pytest.approx(4.8)
    assert values.min() == pytest.approx(-4.8)


def test_a_rated_control_is_averaged_too(rigid_body: dict[str, Any]) -> None:
    rigid_body["problem"] |= {"control_rates": {"u": [-2, 2]}, "initial_control": {"u": 0}}
    rigid_body["output"] = {"command": {"period": 0.01}, "coast": 1}
    command = result_of({**rigid_body, "method": SLEW})["command"]
    assert list(command["controls"]) == ["u"]
    assert command["controls"]["u"][0] == pytest.approx(0.01, abs=1e-9)
    assert list(command["verification"]["states"]) == ["x", "x_dot"]
    assert command["verification"]["terminal_error"] < 1e-3


def test_what_swings_after_the_flight(flexible_spacecraft: dict[str, Any]) -> None:
    """A torque of 1 N m until t = 5 leaves the linear mode with the amplitude that it has in closed form."""
    problem = flexible_spacecraft["problem"]
    small, period = 1e-3, 2 * np.pi / np.sqrt(200 / (500 - 750**2 / 1565))
    problem["model"]["flexible"] = ["alpha"]
    problem |= {"final_time": 5, "final_state": {}, "bounds": {"T": small}, "objective": {"running": "T^2"}}
    result = result_of(
        {**flexible_spacecraft, "method": {"name": "swcm", "J": 3}, "output": {"coast": 2 * period}}
    )
    residual = result["coast"]["residual"]
    # alpha'' + w^2 alpha = -(750/1565) T / M with M = 500 - 750^2/1565: a step on and a step off.
    static = 750 / 1565 * small / 200
    expected = 2 * static * abs(np.sin(np.pi * 5 / period))
    assert residual["alpha"]["amplitude"] == pytest.approx(expected, rel=1e-3)
    energy = residual["vibration_energy"]
    assert energy["max"] == pytest.approx(0.5 * 500 * residual["alpha_dot"]["max"] ** 2, rel=1e-2)
    assert len(result["coast"]["t"]) == len(result["coast"]["states"]["alpha"])


def test_every_plant_flies_the_table(two_plants: dict[str, Any]) -> None:
    two_plants["problem"] |= {"final_state": {"x": [0.5, None]}, "objective": {"running": "u^2"}}
    two_plants["output"] = {"command": {"period": 0.25}}
    command = result_of(two_plants)["command"]
    finals = {name: flight["states"]["x"]["final"] for name, flight in command["scenarios"].items()}
    assert finals == {"nominal": pytest.approx(0.5), "twice": pytest.approx(1)}


def test_a_table_without_end_is_not_made(rigid_body: dict[str, Any]) -> None:
    rigid_body["output"] = {"command": {"period": 1e-6}}
    result = result_of({**rigid_body, "method": {"name": "swcm"}})
    assert result["command"] is None
    assert result["warnings"][-1]["pointer"] == "/output/command/period"
    assert "20,001" in result["warnings"][-1]["detail"]


def test_files_of_a_command() -> None:
    command = {"t": [0.0, 0.5], "period": 0.5, "controls": {"u": [1.0, -1.0], "v": [0.0, 2.0]}}
    assert command_csv(command).splitlines() == ["t,u,v", "0.0,1.0,0.0", "0.5,-1.0,2.0"]
    read = loadmat(io.BytesIO(command_mat(command)))["command"][0, 0]
    np.testing.assert_array_equal(read["time"], [[0], [0.5]])
    np.testing.assert_array_equal(read["signals"][0, 0]["values"], [[1, 0], [-1, 2]])
    assert read["signals"][0, 0]["dimensions"] == 2
