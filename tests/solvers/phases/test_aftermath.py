"""What comes after a flight of phases: its command table, flown through the jumps, and coasting."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from solvers.output.aftermath import asked_for
from solvers.phases.solution import PhasedSolution
from solvers.solve import solve
from solvers.spec import check_document
from tests.solvers.conftest import INTEGRATOR
from tests.solvers.output.test_outputs import result_of
from tests.solvers.phases.test_phases import BOUNCE, GPM, ROCKET, SLIDE_AND_ROLL

Vector = NDArray[np.float64]
Rate = Callable[[float, Vector, float], Sequence[float]]


def flown(
    rate: Rate, start: Sequence[float], table: dict[str, Any], name: str, t0: float, tf: float
) -> Vector:
    """The state at tf of y' = rate(t, y, row) from t0, row after row of a table, by SciPy."""
    begin = np.array(table["t"]) + table["delay"]
    edges = np.unique(np.clip([t0, *begin, begin[-1] + table["period"], tf], t0, tf))
    y = np.array(start, np.float64)
    for left, right in pairwise(edges):
        row = int(np.searchsorted(begin, (left + right) / 2)) - 1
        u = table["controls"][name][row] if row >= 0 else 0.0
        y = solve_ivp(rate, (left, right), y, "DOP853", args=(u,), rtol=1e-12, atol=1e-14).y[:, -1]
    return y


def glide(t: float, y: Vector, u: float) -> Sequence[float]:
    """x'' = u."""
    return y[1], u


def climb(t: float, y: Vector, thrust: float) -> Sequence[float]:
    """The equations of the rocket, by hand."""
    _, v, m = y
    return v, (thrust - 0.1 * v**2) / m - 1.0, -thrust / 2.0


def least(way: float, change: float) -> Callable[[float], float]:
    """The integral from 0 of the control of least energy in a second, which is a straight line.

    ``way``: how much farther than at constant speed it goes, ``change``: of the speed.
    """
    return lambda t: (6 * way - 2 * change) * t + (3 * change - 6 * way) * t**2


def test_a_period_in_which_two_phases_meet() -> None:
    """Falls from 1 to 0 in a second and hits at -1.8, rises in another one from 0.9 and rests at 1."""
    document = {**BOUNCE, "method": GPM, "output": {"command": {"period": 0.3, "delay": 0.07}, "coast": 1}}
    result = result_of(document)
    down, up = least(-1.0, -1.8), least(0.1, -0.9)

    def impulse(t: float) -> float:
        return down(min(t, 1.0)) + up(min(max(t - 1.0, 0.0), 1.0))

    table = result["command"]
    assert table["t"] == pytest.approx(0.3 * np.arange(7))
    means = [(impulse(t + 0.3) - impulse(t)) / 0.3 for t in table["t"]]
    assert table["controls"]["u"] == pytest.approx(means, abs=1e-7)
    # Flown by hand: the body hits the ground at 1 s, whatever the table has made of the way there.
    hit = flown(glide, [1, 0], table, "u", 0, 1)
    end = flown(glide, [hit[0], -0.5 * hit[1]], table, "u", 1, 2.17)
    flight = table["verification"]
    assert [phase["name"] for phase in flight["phases"]] == ["down", "up"]
    assert [phase["final_time"] for phase in flight["phases"]] == pytest.approx([1, 2.17])
    for states, expected in ((flight["phases"][0]["states"], hit), (flight["states"], end)):
        assert [states[name]["final"] for name in ("x", "x_dot")] == pytest.approx(expected, abs=1e-10)
    errors = [phase["terminal_error"] for phase in flight["phases"]]
    assert errors[0] == pytest.approx(abs(hit[0]), abs=1e-10)
    assert flight["terminal_error"] == max(errors)
    after = flight["coast"]
    assert (after["t"][0], after["t"][-1]) == pytest.approx((2.17, 3.17))
    assert after["states"]["x"][-1] == pytest.approx(end[0] + end[1], abs=1e-9)
    # The flight itself ends at rest.
    assert result["coast"]["residual"]["x"]["amplitude"] == pytest.approx(0, abs=1e-6)


def test_a_sample_where_phases_meet_is_that_of_the_next_one() -> None:
    document = {**BOUNCE, "method": GPM, "output": {"command": {"period": 0.25, "rule": "sample"}}}
    values = result_of(document)["command"]["controls"]["u"]
    assert len(values) == 8
    # The straight lines of least energy at 0.75 s, and at the begin of the second one.
    assert values[3:5] == pytest.approx([-2.4 + 1.2 * 0.75, 0.6 + 1.8], abs=1e-6)


def test_a_table_stages_where_the_answer_does() -> None:
    """The rocket, whose time of staging is free, whose thrust is bounded otherwise in each phase."""
    document = {
        **copy.deepcopy(ROCKET),
        "output": {"command": {"period": 0.01, "quantum": {"T": 0.5}}, "coast": 0.5},
    }
    document["problem"]["bounds"]["T"] = [-6, 6]
    document["problem"]["phases"][1]["bounds"]["T"] = [-1, 1]
    result = result_of(document)
    assert result["success"], result["message"]
    table, boost = result["command"], result["phases"][0]
    rows, times = np.array(table["controls"]["T"]), np.array(table["t"])
    np.testing.assert_allclose(rows / 0.5, np.round(rows / 0.5), atol=1e-12)
    # A row that is held in both phases is within both of their bounds.
    assert np.abs(rows[times + 0.01 > boost["tf"]]).max() <= 1
    assert np.abs(rows).max() > 1
    stage = flown(climb, [0, 0, 1.5], table, "T", 0, boost["tf"])
    end = flown(climb, [stage[0], stage[1], stage[2] - 0.2], table, "T", boost["tf"], 1.2)
    finals = [state["final"] for state in table["verification"]["states"].values()]
    assert finals == pytest.approx(end, abs=1e-10)
    # The answer itself is flown on from where it really ends, and falls for half a second.
    coasted, promised = result["coast"]["states"], result["trajectory"]["states"]
    for name, state in result["verification"]["states"].items():
        off = abs(coasted[name][0] - promised[name][-1])
        assert off == pytest.approx(state["terminal_error"], abs=1e-10)
    start = [coasted[name][0] for name in ("h", "v", "m")]
    fallen = solve_ivp(climb, (0, 0.5), start, "DOP853", args=(0.0,), rtol=1e-12).y[:, -1]
    assert [coasted[name][-1] for name in ("h", "v", "m")] == pytest.approx(fallen, abs=1e-8)


def test_a_control_that_a_phase_does_not_have_is_zero_there() -> None:
    """x' = u = 12/13 for a second, then y'' = F from rest to rest over 1/13."""
    output = {"command": {"period": 0.3, "quantum": {"F": 1e-9}}, "coast": 2}
    result = result_of({**SLIDE_AND_ROLL, "output": output})
    table, push = result["command"], least(1 / 13, 0)
    assert table["controls"]["u"] == pytest.approx([12 / 13] * 3 + [4 / 13, 0, 0, 0], abs=1e-8)
    means = [(push(min(t + 0.3, 2) - 1) - push(max(t - 1, 0))) / 0.3 for t in table["t"][3:]]
    assert table["controls"]["F"] == pytest.approx([0, 0, 0, *means], abs=1e-7)
    assert set(table["verification"]["states"]) == {"x", "y", "y_dot"}
    assert set(result["coast"]["states"]) == {"y", "y_dot"}


def test_an_iterate_whose_phases_do_not_follow_each_other_has_no_table() -> None:
    spec = check_document({**BOUNCE, "method": GPM, "output": {"command": {"period": 0.1}, "coast": 1}})
    solution = solve(spec)
    assert isinstance(solution, PhasedSolution)
    first, last = solution.trajectory.parts
    for time in (2.0, 2.5, np.nan):
        crossed = replace(solution.trajectory, parts=(replace(first, tf=time), replace(last, t0=time)))
        found, warnings = asked_for(spec, [crossed])
        assert found["command"] is None
        assert [item["pointer"] for item in warnings] == ["/output/command"]
        assert "note" in found["coast"]


def test_a_row_between_bounds_that_have_nothing_in_common() -> None:
    """Full 2 until 0.5 s, then off: a period over both has the mean, so that the impulse is kept."""
    document = {
        "problem": {
            "model": INTEGRATOR,
            "final_time": 1,
            "initial_state": {"x": 0},
            "objective": {"running": "u^2"},
            "phases": [
                {"name": "burn", "final_time": 0.5, "bounds": {"u": [2, 3]}},
                {"name": "drift", "bounds": {"u": 0}},
            ],
        },
        "method": {"name": "hermite_simpson", "intervals": 8},
        "output": {"command": {"period": 0.4}},
    }
    table = result_of(document)["command"]
    assert table["controls"]["u"] == pytest.approx([2, 0.5, 0], abs=1e-7)
    assert table["verification"]["states"]["x"]["final"] == pytest.approx(1, abs=1e-7)
