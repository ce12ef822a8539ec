"""What becomes of a first answer to phases: exact arcs in every phase, adapted meshes, what is best."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from solvers.catalogue import load_case
from tests.solvers.conftest import REGULATOR, RIGID_BODY
from tests.solvers.output.test_outputs import result_of


def cut(plain: dict[str, Any], *phases: dict[str, Any], **keys: Any) -> dict[str, Any]:
    """The problem of a document, flown in phases, without its method unless one is among the ``keys``."""
    document = {"problem": copy.deepcopy(plain["problem"]), **keys}
    named = [{"name": f"part{index}", **phase} for index, phase in enumerate(phases)]
    document["problem"]["phases"] = named
    return document


def test_one_phase_is_refined_as_the_problem_itself() -> None:
    alone, phased = result_of({"problem": RIGID_BODY["problem"]}), result_of(cut(RIGID_BODY, {}))
    for key in ("objective", "final_time", "switching", "method"):
        assert phased[key] == alone[key], key
    assert phased["verification"]["checks"][-2:] == alone["verification"]["checks"][-2:]


@pytest.mark.parametrize(
    ("first", "method"),
    [
        ({"final_state": {"x": 0.3}}, {}),  # the choice is the solver's
        ({"final_state": {"x": 0.8}}, {"method": {"name": "gpm", "refine": "switching"}}),
        ({"final_time": 0.7}, {"method": {"name": "hermite_simpson", "refine": "switching"}}),
    ],
    ids=["waypoint before", "waypoint behind", "given time"],
)
def test_least_time_does_not_depend_on_cuts(first: dict[str, Any], method: dict[str, Any]) -> None:
    """A unit of way with |u| <= 1 takes 2 and switches at 1, wherever the flight is cut."""
    result = result_of(cut(RIGID_BODY, first, {}, **method))
    assert result["success"], result["message"]
    assert result["method"]["refine"] == "switching"
    assert result["objective"] == pytest.approx(2.0, abs=1e-9)
    assert result["switching"]["u"]["levels"] == [1.0, -1.0]
    assert result["switching"]["u"]["times"] == pytest.approx([1.0], abs=1e-8)
    checks = {check["name"] for check in result["verification"]["checks"]}
    assert checks >= {"switching_sign", "hamiltonian_drift", "link"}


@pytest.mark.parametrize("second", [{"bounds": {"u": [-2, 2]}}, {"parameters": {"m": 0.5}}])
def test_a_stronger_second_phase(second: dict[str, Any]) -> None:
    """|u| <= 1 over the first quarter, then accelerations up to 2, with twice the torque or half the mass.

    At the cut v^2 = 1/2; then v^2 rises by 4 and falls by 4 over each unit of way, so that its peak is 7/4.
    """
    result = result_of(cut(RIGID_BODY, {"final_state": {"x": 0.25}}, second))
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(np.sqrt(0.5) / 2 + np.sqrt(1.75), abs=1e-9)
    assert result["phases"][0]["tf"] == pytest.approx(np.sqrt(0.5), abs=1e-8)
    bound = second.get("bounds", {}).get("u", [-1, 1])[1]
    # The bound of the common problem stands for both phases where the second has none of its own.
    slopes = result["sensitivity"]
    if bound == 1:
        # Over a the longest time scales with sqrt(m/u): d t/d u = -t/(2 u), shared by all of the flight.
        total = slopes["/problem/bounds/u/1"] - slopes["/problem/bounds/u/0"]
        assert total == pytest.approx(-result["objective"] / 2, rel=1e-6)


def test_the_slew_in_two_phases() -> None:
    slew = load_case("flexible_spacecraft")
    result = result_of(cut(slew, {}, {}, method={"name": "swcm", "refine": "switching"}))
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(slew["reference"]["final_time"], abs=1e-8)
    assert result["switching"]["T"]["times"] == pytest.approx(slew["reference"]["switching"]["T"], abs=1e-8)


@pytest.mark.parametrize("time", [0.3, 0.5])
def test_a_limit_that_is_followed_across_a_cut(time: float) -> None:
    """Bryson and Denham's problem keeps to its limit from 1/3 to 2/3; 4 / (9 l) in closed form."""
    result = result_of(cut(load_case("bryson_denham"), {"final_time": time}, {}))
    assert result["success"], result["message"]
    assert result["method"]["refine"] == "switching"
    assert result["objective"] == pytest.approx(4.0, abs=1e-9)


@pytest.mark.parametrize(
    "method",
    [
        {"name": "swcm", "J": 2, "adaptive": {"tolerance": 1e-6}},
        {"name": "gpm", "nodes": 6, "adaptive": {"tolerance": 1e-9}},
        {"name": "hermite_simpson", "intervals": 10, "adaptive": {"tolerance": 1e-7}},
    ],
    ids=lambda method: str(method["name"]),
)
def test_every_phase_adapts_its_own_mesh(method: dict[str, Any]) -> None:
    plain = load_case("van_der_pol")
    tolerance = method["adaptive"]["tolerance"]
    result = result_of(cut(plain, {"final_time": 0.5}, {}, method=method))
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(plain["reference"]["objective"], rel=tolerance)
    assert result["verification"]["tolerances"]["terminal_error"] == tolerance
    assert len(result["convergence"]) > 1
    assert len(result["method"]["adaptive"]["phases"]) == 2


def test_a_jump_carries_the_errors_of_meshes_on() -> None:
    """What a jump makes 300 times as large has to be that much smaller before it."""
    model = {**REGULATOR["problem"]["model"], "dynamics": {"x": "u - sin(x)"}}
    document = cut(
        {"problem": {**REGULATOR["problem"], "model": model}},
        {"final_time": 0.5},
        {},
        method={"name": "hermite_simpson", "intervals": 3, "adaptive": {"tolerance": 1e-7}},
    )
    document["problem"]["links"] = [{"from": "part0", "to": "part1", "jump": {"x": "300*(x_f - 0.45)"}}]
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["verification"]["terminal_error"] <= 1e-7


def test_coasting_between_two_burns() -> None:
    """Speeding up, a second without thrust, slowing down: v^2 + v = 1, and 2 v + 1 in all."""
    drift = {"bounds": {"u": 0}, "boundary_constraints": [{"expression": "tf - t0", "bounds": 1}]}
    document = cut(RIGID_BODY, {}, drift, {}, method={"name": "gpm", "refine": "switching"})
    document["problem"]["guess"] = {"final_time": 3}
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(np.sqrt(5), abs=1e-9)
    assert result["switching"]["u"]["levels"] == [1.0, None, -1.0]


def test_a_phase_that_shrinks_to_nothing_is_named() -> None:
    """To coast for as long as one likes costs time: the best is not to."""
    way = {"final_state": {"x": 0.3}}, {"bounds": {"u": 0}}, {}
    result = result_of(cut(RIGID_BODY, *way, method={"name": "gpm", "nodes": 10}))
    assert result["objective"] == pytest.approx(2, abs=0.01)
    assert [(item["code"], item["pointer"]) for item in result["warnings"]] == [
        ("empty_phase", "/problem/phases/1")
    ]


def test_a_guess_of_the_whole_flight() -> None:
    """Goddard's rocket, cut along its singular arc, from the guess that it needs."""
    goddard = load_case("goddard")
    result = result_of(cut(goddard, {"final_time": 0.05}, {}))
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(goddard["reference"]["objective"], abs=1e-9)
    assert result["switching"]["T"]["arcs"] == ["upper", "interior", "lower"]


def test_what_is_not_refined_is_adapted() -> None:
    """A window along one phase is none of arcs: the choice falls on meshes, and an order is refused."""
    document = cut(
        REGULATOR,
        {
            "final_time": 0.5,
            "path_constraints": [{"expression": "u", "bounds": [-5, 5], "during": [0, 0.5]}],
        },
        {},
    )
    result = result_of(document)
    assert result["success"], result["message"]
    assert "adaptive" in result["method"]
    assert result["objective"] == pytest.approx(np.tanh(1) / 2, abs=1e-6)
