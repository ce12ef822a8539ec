"""One command for several plants over all phases: closed forms, and the slew that rests at any stiffness."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from solvers.catalogue import load_case
from solvers.sizes import problem_size
from solvers.spec import check_document
from tests.solvers.output.test_outputs import result_of

TWO_PHASES = [{"name": "first", "final_time": 0.7}, {"name": "second"}]


def plant(dynamics: str, **parameters: float) -> dict[str, Any]:
    """The model x' = dynamics."""
    model = {"kind": "first_order", "states": ["x"], "controls": ["u"], "parameters": parameters}
    return {**model, "dynamics": {"x": dynamics}}


@pytest.mark.parametrize(
    ("choice", "objective", "way", "weights"),
    [
        ("nominal", 1 / 21, 1 / 1.05, (1, 0, 0)),
        ("mean", 1 - 3.5**2 / 9 / 1.8, 3.5 / 3 / 1.8, (1 / 3, 1 / 3, 1 / 3)),
        # The weights of the worst two, with which their sum is least at the same U.
        ("worst", 0.6**2 + 0.05 * 0.8**2, 0.8, (0, 2.48 / 3, 0.52 / 3)),
    ],
)
def test_the_objective_that_is_chosen_counts_over_all_phases(
    choice: str, objective: float, way: float, weights: tuple[float, ...]
) -> None:
    """x' = a u for a second or two: with U the integral of u, (a U - 1)^2 + U^2 / 20 for a of 1/2, 1 and 2.

    Least for U = 1/1.05 with a = 1 alone, for mean(a) / (mean(a^2) + 1/20) on the average; the worst of them
    is least where 1 - U/2 = 2 U - 1.
    """
    document = {
        "problem": {
            "model": plant("a*u", a=1),
            "final_time": 2,
            "initial_state": {"x": 0},
            "objective": {"terminal": "(x_f - 1)^2", "running": "0.1*u^2"},
            "scenarios": {
                "objective": choice,
                "cases": [
                    {"name": "weak", "parameters": {"a": 0.5}},
                    {"name": "strong", "parameters": {"a": 2}},
                ],
            },
            "phases": TWO_PHASES,
        },
        "method": {"name": "gpm", "nodes": 8},
    }
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(objective, abs=1e-9)
    places = ("model/parameters/a", "scenarios/cases/0/parameters/a", "scenarios/cases/1/parameters/a")
    for name, gain, place, weight in zip(
        ("nominal", "weak", "strong"), (1, 0.5, 2), places, weights, strict=True
    ):
        slope = weight * 2 * (gain * way - 1) * way
        assert result["sensitivity"][f"/problem/{place}"] == pytest.approx(slope, abs=1e-6)
        scenario = result["scenarios"][name]
        assert scenario["trajectory"]["states"]["x"][-1] == pytest.approx(gain * way, abs=1e-7)
        assert scenario["verification"]["passed"]
        assert len(scenario["trajectory"]["t"]) == len(result["trajectory"]["t"])


def test_jumps_and_integrals_of_every_plant() -> None:
    """x' = u for a second, times a, u for another: u^2 each and (a u1 + u2 - 1)^2 on the average of a = 1, 3.

    Both are 1/4; x covers 1/8 and then 3/8 where a = 1.
    """
    document = {
        "problem": {
            "model": plant("u", a=1),
            "final_time": 2,
            "initial_state": {"x": 0},
            "objective": {"terminal": "(x_f - 1)^2", "running": "u^2"},
            "integrals": [
                {"name": "way", "expression": "x"},
                {"name": "push", "expression": "u", "bounds": [None, 0.6]},
            ],
            "boundary_constraints": [{"expression": "x_f - x_0", "bounds": [None, 2]}],
            "scenarios": {"objective": "mean", "cases": [{"name": "leap", "parameters": {"a": 3}}]},
            "phases": [{"name": "first", "final_time": 1}, {"name": "second"}],
            "links": [{"from": "first", "to": "second", "jump": {"x": "a*x_f"}}],
        },
        "method": {"name": "gpm", "nodes": 8},
        "output": {"command": {"period": 0.5}, "coast": 1},
    }
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(0.25, abs=1e-9)
    assert result["integrals"] == pytest.approx({"way": 0.5, "push": 0.5}, abs=1e-7)
    ends = [result["scenarios"][name]["trajectory"]["states"]["x"][-1] for name in ("nominal", "leap")]
    assert ends == pytest.approx([0.5, 1.0], abs=1e-7)
    assert set(result["command"]["scenarios"]) == {"nominal", "leap"}
    size, told = problem_size(check_document(document)), result["statistics"]
    assert (size.variables, size.constraints) == (told["variables"], told["constraints"])


def test_a_slew_that_rests_whatever_the_stiffness() -> None:
    """Rest at k = 90, 100 and 110 with one command takes 27.56910424 by single shooting, uncut.

    Ten arcs, with the steps of DOP853 in CasADi and IPOPT over their lengths; 27.569 by 1,200 Hermite-Simpson
    intervals. Angular momentum is common to all plants: ends that follow from others are not asked for twice.
    """
    document = copy.deepcopy(load_case("flexible_spacecraft"))
    document["problem"] |= {
        "phases": [{"name": "first", "final_time": 13}, {"name": "second"}],
        "scenarios": {
            "cases": [
                {"name": "soft", "parameters": {"k": 90}},
                {"name": "stiff", "parameters": {"k": 110}},
            ]
        },
    }
    del document["method"]
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(27.56910424, abs=1e-8)
    assert [item["code"] for item in result["warnings"]] == ["implied_ends"]
    for scenario in result["scenarios"].values():
        checks = {check["name"]: check["value"] for check in scenario["verification"]["checks"]}
        assert checks["terminal_error"] < 1e-9
        assert checks.get("implied_ends", 0.0) < 1e-5
