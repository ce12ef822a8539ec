"""Flights of an answer against closed forms and against an integration of equations written by hand."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from solvers.catalogue import load_case
from solvers.flights.fly import FlightsStopped
from solvers.flights.run import run_flights
from solvers.progress import ProgressReport
from solvers.solve import solve
from solvers.spec import check_document
from solvers.spec.flights import check_flights
from solvers.status import SolveStatus
from solvers.verification.flight import FlightError
from tests.solvers.conftest import REGULATOR, RIGID_BODY

Document = dict[str, Any]
Vector = NDArray[np.float64]


def answer(document: Document) -> Document:
    """The result of a document, as it is stored."""
    return dict(json.loads(json.dumps(solve(check_document(document)).result())))


def flown(answered: Document, **asked: Any) -> Document:
    """What came of flights."""
    spec = check_flights(asked, answered["resolved"]["document"])
    return dict(json.loads(json.dumps(run_flights(spec, answered).result(), allow_nan=False)))


@pytest.fixture(scope="module")
def slew() -> Document:
    """The exact optimum of the flexible spacecraft: 25.8661 s, three switches."""
    return answer({"problem": load_case("flexible_spacecraft")["problem"], "method": {"name": "auto"}})


@pytest.fixture(scope="module")
def body() -> Document:
    """A rigid body from 0 to 1 at rest in exactly 2 s, with a mass that follows from a density."""
    document = copy.deepcopy(RIGID_BODY)
    document["problem"]["model"]["parameters"] = {"rho": 1, "m": "rho"}
    document["problem"]["outputs"] = [{"name": "impulse", "expression": "m*x_dot"}]
    document["method"] = {"name": "swcm", "refine": "switching"}
    return answer(document)


def spacecraft(
    torque: Callable[[float], float], breaks: Vector, k: float = 100.0, lag: float = 0.0, coast: float = 0.0
) -> tuple[Vector, float]:
    """The end of a flight under a torque that is smooth between ``breaks``, and how the tip swings after it.

    Equations by hand, SciPy's DOP853; a lagging actuator is switched off at the end.
    """
    jb, r, m, length = 440.0, 2.5, 10.0, 5.0

    def rate(t: float, y: Vector, start: float, stop: float, flying: bool) -> Vector:
        q, v, given = y[:2], y[2:4], y[4]
        inside = min(max(t, start + 1e-12), stop - 1e-12)
        told = torque(inside) if flying else 0.0
        felt = (given if lag else told) if flying else 0.0
        c, s = np.cos(q[1]), np.sin(q[1])
        coupling = 2 * m * (length**2 + r * length * c)
        mass = np.array(
            [[jb + 2 * m * (r**2 + length**2 + 2 * r * length * c), coupling], [coupling, 2 * m * length**2]]
        )
        force = np.array(
            [
                felt + 2 * m * r * length * s * v[1] * (2 * v[0] + v[1]),
                -2 * m * r * length * s * v[0] ** 2 - 2 * k * q[1],
            ]
        )
        actuator = (told - given) / lag if lag else 0.0
        return np.array([*v, *np.linalg.solve(mass, force), actuator])

    y = np.zeros(5)
    for start, stop in pairwise(breaks):
        y = solve_ivp(rate, (start, stop), y, "DOP853", args=(start, stop, True), rtol=1e-12, atol=1e-14).y[
            :, -1
        ]
    end = y[:4].copy()
    if not coast:
        return end, 0.0
    times = np.linspace(breaks[-1], breaks[-1] + coast, 401)
    y[4] = 0.0
    after = solve_ivp(
        rate,
        times[[0, -1]],
        y,
        "DOP853",
        args=(times[0], times[-1], False),
        rtol=1e-12,
        atol=1e-14,
        t_eval=times,
    )
    return end, float(np.ptp(after.y[1])) / 2.0


def bang(slew: Document, delay: float = 0.0) -> tuple[Callable[[float], float], Vector]:
    """The torque of the optimum, late by a delay, and where it jumps until it has ended."""
    found = slew["switching"]["T"]
    switches, tf = np.array(found["times"]), slew["final_time"]

    def torque(t: float) -> float:
        own = t - delay
        return found["levels"][int(np.searchsorted(switches, own))] if 0.0 < own < tf else 0.0

    own = np.array([0.0, *switches, tf])
    return torque, np.unique([0.0, *(own + delay)])


def ends(result: Document, of: str = "nominal") -> list[float]:
    """The four states at the end of the undisturbed flight."""
    return [result["final"][name][of] for name in ("theta", "alpha", "theta_dot", "alpha_dot")]


@pytest.mark.parametrize(
    ("k", "lag", "delay", "swing"),
    [(90.0, 0.0, 0.0, 8.6e-3), (100.0, 0.2, 0.0, 2.8e-3), (106.0, 0.1, 0.02, None)],
)
def test_a_flight_is_what_the_equations_say(
    slew: Document, k: float, lag: float, delay: float, swing: float | None
) -> None:
    torque, breaks = bang(slew, delay)
    end, amplitude = spacecraft(torque, breaks, k, lag, coast=60.0)
    result = flown(
        slew,
        runs=1,
        parameters={"k": {"values": [k]}},
        actuator={"T": {"lag": lag, "delay": delay}},
        coast=60,
    )
    np.testing.assert_allclose(ends(result, "max"), end, rtol=0, atol=1e-8)
    assert result["residual"]["alpha"]["max"] == pytest.approx(amplitude, abs=1e-8)
    if swing is not None:
        assert result["residual"]["alpha"]["max"] == pytest.approx(swing, abs=0.5e-4)


@pytest.mark.parametrize(("rule", "least", "most"), [("sample", 5.2e-3, 5.3e-3), ("average", 0.0, 2.4e-5)])
def test_a_table_is_flown_row_by_row(slew: Document, rule: str, least: float, most: float) -> None:
    command = {"period": 0.1, "rule": rule}
    result = flown(slew, runs=1, use="command", command=command)
    assert result["final_time"] == pytest.approx(25.9)
    miss = np.array(ends(result)) - [np.pi / 6, 0, 0, 0]
    assert least <= np.abs(miss[:2]).max() <= most
    document = copy.deepcopy(slew["resolved"]["document"])
    document["output"] = {"command": command}
    table = solve(check_document(document)).result()["command"]
    values = np.array(table["controls"]["T"])
    edges = np.append(table["t"], table["t"][-1] + 0.1)
    end, _ = spacecraft(lambda t: values[np.searchsorted(edges, t) - 1], edges)
    np.testing.assert_allclose(ends(result), end, rtol=0, atol=1e-8)


def test_the_worst_of_many_flights_can_be_flown_again(slew: Document) -> None:
    """Every flight is as exact as one by itself, though all of them take the same steps."""
    asked: Document = {
        "parameters": {"k": {"uniform": [90, 110]}, "m": {"normal": [10, 0.1]}},
        "initial_state": {"theta_dot": {"normal": [0, 1e-5]}},
        "actuator": {"T": {"lag": 0.1, "delay": 0.02}},
        "seed": 1,
    }
    result = flown(slew, runs=100, worst=2, **asked)
    assert [item["run"] for item in result["worst"]] != [0, 1]
    for item in result["worst"]:
        asked |= {
            key: {name: {"values": [value]} for name, value in item[key].items()}
            for key in ("parameters", "initial_state")
        }
        again = flown(slew, runs=1, **asked)
        assert again["columns"]["alpha_f"][0] == pytest.approx(item["final"]["alpha"], abs=1e-9)
        assert again["worst"][0]["tolerances"] == pytest.approx(item["tolerances"], rel=1e-6)


def test_percentiles_and_rates_against_a_closed_form(body: Document) -> None:
    """x_f = 1/m: with m uniform in [0.8, 1.2] its percentiles are known, and how often it misses by 5 %."""
    result = flown(body, runs=2000, parameters={"rho": {"uniform": [0.8, 1.2]}}, tolerance=0.05)
    columns = result["columns"]
    masses = np.array(columns["rho"])
    np.testing.assert_allclose(columns["x_f"], 1.0 / masses, rtol=1e-10)
    # What does not depend on the mass: the impulse at the end, and on the way at most 1.
    np.testing.assert_allclose(columns["impulse_f"], 0.0, atol=1e-10)
    assert result["outputs"]["impulse"]["max"]["min"] == pytest.approx(1.0, abs=1e-9)
    told = result["final"]["x"]
    assert told["nominal"] == pytest.approx(1.0, abs=1e-9)
    assert told["mean"] == pytest.approx(np.log(1.2 / 0.8) / 0.4, abs=5e-3)
    assert told["percentiles"]["50"] == pytest.approx(1.0, abs=1e-2)
    assert told["percentiles"]["95"] == pytest.approx(1.0 / 0.82, abs=1e-2)
    missed = {item["pointer"]: item for item in result["violations"]}["/problem/final_state/x"]
    expected = 1.0 - (1.0 / 0.95 - 1.0 / 1.05) / 0.4
    assert missed["rate"] == pytest.approx(expected, abs=0.03)
    assert missed["rate"] == np.mean(np.abs(1.0 / masses - 1.0) > 0.05)
    assert result["worst"][0]["parameters"]["rho"] == masses.min()


def test_an_attitude_is_missed_by_the_sine_of_half_the_angle() -> None:
    """A body that turns freely by 1 rad about its third axis in a second, from another rate."""
    answered = answer(
        {
            "problem": {
                "model": {"kind": "library", "name": "attitude_flexible", "options": {"modes": 0}},
                "final_time": 1,
                "initial_state": {"q4": 1, "w3": 1, "*": 0},
                "final_attitude": [0, 0, "sin(0.5)", "cos(0.5)"],
                "objective": {"running": "T1^2 + T2^2 + T3^2"},
            },
            "method": {"name": "gpm", "nodes": 12},
        }
    )
    result = flown(answered, runs=20, initial_state={"w3": {"uniform": [-0.1, 0.1]}}, tolerance=0.02)
    missed = np.abs(np.sin((np.array(result["columns"]["w3_f"]) - 1) / 2))
    # Of the three components of the error the third one.
    told = [item for item in result["violations"] if item["pointer"] == "/problem/final_attitude"]
    assert [item["rate"] for item in told] == [0, 0, np.mean(missed > 0.02)]
    assert told[2]["max"] == pytest.approx(missed.max(), abs=1e-7)


def test_a_lag_against_its_closed_form(body: Document) -> None:
    """The speed at the end is what the actuator still owes of an impulse of zero."""
    lag = 0.3
    result = flown(body, runs=1, actuator={"u": {"lag": lag}}, coast=10, actuator_after="decay")
    # u_a at the end of +1 for a second and -1 for another one.
    owed = (2.0 - np.exp(-1.0 / lag)) * np.exp(-1.0 / lag) - 1.0
    # x_dot_f: the integral of the command, 0, less what the actuator still owes.
    assert result["final"]["x_dot"]["nominal"] == pytest.approx(-lag * owed, abs=1e-9)
    # Switched off at once it drifts with that speed; let die away it comes to rest.
    drift = flown(body, runs=1, actuator={"u": {"lag": lag}}, coast=10)["residual"]["x"]["nominal"]
    assert drift == pytest.approx(-lag * owed * 10.0 / 2.0, abs=1e-8)
    assert result["residual"]["x"]["nominal"] == pytest.approx(-(lag**2) * owed / 2.0, abs=1e-8)


def test_numbers_follow_the_seed_and_the_name_alone(body: Document) -> None:
    few = flown(body, runs=5, seed=3, parameters={"rho": {"normal": [1, 0.1]}})["columns"]
    more = flown(
        body,
        runs=9,
        seed=3,
        initial_state={"x": {"normal": [0, 0.1]}},
        parameters={"rho": {"normal": [1, 0.1]}},
    )["columns"]
    assert more["rho"][:5] == few["rho"]
    other = flown(body, runs=5, seed=4, parameters={"rho": {"normal": [1, 0.1]}})["columns"]
    assert other["rho"] != few["rho"]
    masses, starts = np.array(more["rho"]), np.array(more["x_0"])
    np.testing.assert_allclose(more["x_f"], starts + 1.0 / masses, atol=1e-10)


def test_a_flight_that_runs_away_is_given_up_alone() -> None:
    """x' = u + b x^2 from 1 has no end before t = 1 where b is 2; others go on undisturbed."""
    document = copy.deepcopy(REGULATOR)
    document["problem"]["model"] |= {"parameters": {"b": 0}, "dynamics": {"x": "u + b*x^2"}}
    document["problem"]["path_constraints"] = [{"name": "low", "expression": "x", "bounds": [None, 1.05]}]
    answered = answer({**document, "method": {"name": "gpm", "nodes": 12}})
    result = flown(answered, runs=4, parameters={"b": {"values": [0.0, 4.0]}}, seed=2, worst=4)
    lost = [b == 4.0 for b in result["columns"]["b"]]
    assert 0 < result["lost"] == sum(lost) < 4
    assert [value is None for value in result["columns"]["x_f"]] == lost
    kept = [value for value in result["columns"]["x_f"] if value is not None]
    np.testing.assert_allclose(kept, 1.0 / np.cosh(1.0), atol=1e-6)
    assert result["violations"][0]["rate"] == 0.0
    assert [item["lost"] for item in result["worst"]] == sorted(lost, reverse=True)
    answered["resolved"]["document"]["problem"]["model"]["parameters"]["b"] = 4.0
    with pytest.raises(FlightError, match="undisturbed"):
        flown(answered, runs=1)


def test_path_constraints_are_looked_at_in_their_window(body: Document) -> None:
    answered = copy.deepcopy(body)
    answered["resolved"]["document"]["method"] = {"name": "swcm"}
    answered["resolved"]["document"]["problem"]["path_constraints"] = [
        {"name": "slow", "expression": "x_dot", "bounds": [None, 0.75]},
        {"name": "late", "expression": "x_dot", "bounds": [None, 0.75], "during": [0.8, 1.0]},
    ]
    result = flown(answered, runs=1, parameters={"rho": {"values": [1.25]}}, tolerance=1e-6)
    rates = {item["name"]: (item["rate"], item["max"], item["nominal"]) for item in result["violations"]}
    # At most 1/m at half time; the window begins when it is 0.4/m.
    assert rates["slow"] == (1.0, pytest.approx(0.05, abs=1e-9), pytest.approx(0.25, abs=1e-9))
    assert rates["late"] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("model", "parameter"),
    [
        ({"kind": "library", "name": "rigid_body"}, "m"),
        (
            {
                "kind": "modal",
                "axes": ["x"],
                "inertia": [["J"]],
                "controls": ["u"],
                "input": [[1]],
                "parameters": {"J": 1, "f1": 0.5},
                "modes": [{"name": "p", "frequency_hz": "f1", "damping": 0.01, "coupling": [0.3]}],
                "mode_basis": "constrained",
            },
            "f1",
        ),
    ],
)
def test_models_of_the_library_and_modal_ones(model: Document, parameter: str) -> None:
    document = copy.deepcopy(RIGID_BODY)
    document["problem"]["model"] = model
    if model["kind"] == "modal":
        document["problem"]["initial_state"] = document["problem"]["final_state"] = {"x": 1, "*": 0}
        document["problem"] |= {"final_time": 3, "objective": {"running": "u^2"}, "initial_state": {"*": 0}}
    answered = answer({**document, "method": {"name": "hermite_simpson"}})
    nominal = answered["resolved"]["document"]["problem"]["model"]["parameters"][parameter]
    result = flown(answered, runs=3, parameters={parameter: {"values": [nominal]}}, coast=5)
    for name, told in result["final"].items():
        assert told["min"] == told["max"] == told["nominal"]
        assert told["nominal"] == pytest.approx(answered["nodes"]["states"][name][-1], abs=1e-4)
    other = flown(answered, runs=1, parameters={parameter: {"values": [1.1 * nominal]}})
    assert abs(other["final"]["x"]["max"] - other["final"]["x"]["nominal"]) > 1e-6


def test_rated_controls_are_flown_and_what_names_their_rate_is_said(rigid_body: Document) -> None:
    problem = rigid_body["problem"]
    problem |= {"control_rates": {"u": [-5, 5]}, "outputs": [{"name": "jerk", "expression": "u_dot"}]}
    problem |= {"initial_control": {"u": 0}, "final_control": {"u": 0}}
    answered = answer({**rigid_body, "method": {"name": "swcm", "L": 8, "J": 3}})
    result = flown(answered, runs=1)
    assert result["final"]["x"]["nominal"] == pytest.approx(1.0, abs=1e-3)
    assert [item["pointer"] for item in result["warnings"]] == ["/problem/outputs/0"]
    assert result["outputs"] == {}
    problem |= {"final_time": 3, "objective": {"running": "u_dot^2"}, "outputs": []}
    rigid_body["output"] = {"command": {"period": 0.1}}
    answered = answer({**rigid_body, "method": {"name": "swcm", "L": 8, "J": 3}})
    assert answered["command"]["verification"]["states"]["x"]["final"] == pytest.approx(1.0, abs=1e-3)
    result = flown(answered, runs=1)
    assert [item["pointer"] for item in result["warnings"]] == ["/problem/objective/running"]
    assert result["objective"]["nominal"] is None


def test_a_data_table_over_time_is_met_at_its_corners(body: Document) -> None:
    """A push of 0.1 from t = 0.7 on, while the command is late: each has its own jumps."""
    answered = copy.deepcopy(body)
    document = answered["resolved"]["document"]
    document["method"] = {"name": "swcm"}
    push = {"x": [0, 0.7, 3], "values": [0, 0.1, 0], "interpolation": "previous", "outside": "hold"}
    document["problem"]["data"] = {"push": push}
    document["problem"]["model"]["force"] = ["push(t)"]
    result = flown(answered, runs=1, actuator={"u": {"delay": 0.05}}, coast=2)
    assert result["final"]["x"]["nominal"] == pytest.approx(1.0 + 0.1 * 1.35**2 / 2.0, abs=1e-11)
    # It ends at t = 3 with the speed 0.23: a second and 0.05 s later the flight is over.
    far = 0.1 * (0.135 * 0.95 / 0.1 + 0.95**2 / 2.0) + 0.23 * 1.05
    # The switch of the answer is that of its program, to its tolerance.
    assert result["residual"]["x"]["nominal"] == pytest.approx(far / 2.0, abs=1e-9)


class Impatient:
    """Asks to stop after so many questions."""

    def __init__(self, patience: int) -> None:
        self.asked, self.patience = 0, patience
        self.fractions: list[float] = []

    def report(self, report: ProgressReport) -> None:
        assert report.stage == "fly"
        assert report.fraction is not None
        self.fractions.append(report.fraction)

    def cancelled(self) -> bool:
        self.asked += 1
        return self.asked > self.patience


def test_flights_are_stopped_between_steps(body: Document) -> None:
    spec = check_flights({"runs": 10_000, "coast": 1e6}, body["resolved"]["document"])
    progress = Impatient(50)
    with pytest.raises(FlightsStopped) as stopped:
        run_flights(spec, body, progress)
    assert stopped.value.status is SolveStatus.CANCELLED
    assert progress.fractions == sorted(progress.fractions)
    with pytest.raises(FlightsStopped) as late:
        run_flights(spec, body, seconds=0.0)
    assert late.value.status is SolveStatus.TIME_LIMIT
