"""Peaks, and costs with corners: the same optimum as by hand, and a warning where corners stay."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from solvers.sizes import problem_size
from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory
from tests.solvers.output.test_outputs import each_method, result_of
from tests.solvers.spec.editing import edited, faults_of


@each_method
@pytest.mark.parametrize(
    ("peak", "limits", "expected"),
    [
        # Rest to rest over 1 in time 2: the smallest force is full force throughout.
        ("abs(u)", {}, 1.0),
        # |u| <= 2: speed v for most of the time, 2 v - v^2/2 = 1.
        ("x_dot", {"u": [-2, 2]}, 2 - np.sqrt(2)),
    ],
)
def test_a_peak(
    rigid_body: dict[str, Any], method: dict[str, Any], peak: str, limits: dict[str, Any], expected: float
) -> None:
    problem = rigid_body["problem"]
    problem |= {"final_time": 2, "bounds": limits, "objective": {"maximum": peak}}
    spec = check_document({**rigid_body, "method": method})
    solution, size = solve(spec), problem_size(spec)
    result = solution.result()
    assert result["statistics"]["nlp_status"] == "Solve_Succeeded"
    assert result["objective"] == pytest.approx(expected, rel=2e-2)
    if method["name"] == "swcm":
        assert result["success"], result["message"]
        assert result["verification"]["objective"] == pytest.approx(expected, rel=2e-2)
    assert list(result["nodes"]["controls"]) == ["u"]
    assert result["design"] == {}
    assert (size.variables, size.constraints) == (
        solution.statistics.variables,
        solution.statistics.constraints,
    )


def test_a_peak_is_a_gene_of_a_genetic_search(rigid_body: dict[str, Any]) -> None:
    rigid_body["problem"] |= {"final_time": 2, "bounds": {"u": [-2, 2]}, "objective": {"maximum": "x_dot"}}
    rigid_body["method"] = {"name": "ga", "generations": 30, "boundary": "interval", "scaling_functions": 10}
    result = result_of(rigid_body)
    assert result["success"], result["message"]
    best = 2 - np.sqrt(2)
    assert best < result["objective"] < 1.05 * best  # ten functions cannot jump
    assert result["verification"]["objective"] == pytest.approx(result["objective"], rel=1e-5)
    assert result["design"] == {}


@each_method
@pytest.mark.parametrize("cost", ["abs(u)", "2*max(u, -u)/2", "-min(-u, u)*w"])
def test_fuel(rigid_body: dict[str, Any], method: dict[str, Any], cost: str) -> None:
    """Time 2.6: bursts of length a with a (2.6 - a) = 1."""
    problem = rigid_body["problem"]
    problem["model"]["parameters"] = {"m": 1, "w": 1}
    problem |= {"final_time": 2.6, "objective": {"running": cost}}
    result = result_of({**rigid_body, "method": method})
    burst = (2.6 - np.sqrt(2.6**2 - 4)) / 2
    # One polynomial takes its price for the jumps.
    assert result["objective"] == pytest.approx(2 * burst, rel=2e-2)
    assert not [item for item in result["warnings"] if item["code"] == "nonsmooth"]


@pytest.mark.parametrize(
    ("method", "cost"),
    [
        ({"name": "auto"}, {"terminal": "0*x_f - -fuel*2"}),
        ({"name": "gpm", "refine": "switching"}, {"running": "2*abs(u) + 0*x"}),
    ],
    ids=["auto", "gpm"],
)
def test_fuel_by_arcs(rigid_body: dict[str, Any], method: dict[str, Any], cost: dict[str, str]) -> None:
    """Time 3, and twice the price: a (3 - a) = 1 between bursts that end and begin exactly."""
    problem = rigid_body["problem"]
    problem["integrals"] = [{"name": "fuel", "expression": "abs(u)"}]
    problem |= {"final_time": 3, "objective": cost}
    result = result_of({**rigid_body, "method": method})
    assert result["success"], result["message"]
    assert result["method"]["refine"] == "switching"
    burst = (3 - np.sqrt(5)) / 2
    assert result["objective"] == pytest.approx(4 * burst, abs=1e-9)
    assert result["integrals"]["fuel"] == pytest.approx(2 * burst, abs=1e-9)
    assert list(result["nodes"]["controls"]) == ["u"]
    (switching,) = result["switching"].values()
    assert switching["times"] == pytest.approx([burst, 3 - burst], abs=1e-9)
    assert switching["levels"] == [1.0, None, -1.0]
    assert switching["arcs"] == ["upper", "interior", "lower"]
    # From there with more time: the arcs are known.
    problem["final_time"] = 3.1
    longer = check_document({**rigid_body, "method": method, "warm_start": "the first one"})
    again = solve(longer, earlier=Trajectory.from_result(result))
    assert again.success, again.message
    assert again.objective == pytest.approx(2 * (3.1 - np.sqrt(3.1**2 - 4)), abs=1e-9)
    assert again.statistics.iterations <= 6


def test_fuel_is_flown_as_it_stands_by_a_genetic_search(rigid_body: dict[str, Any]) -> None:
    """There the control is the document's own, not two sides of it."""
    problem = rigid_body["problem"]
    problem |= {"final_time": 3, "objective": {"running": "abs(u)"}}
    ga = {"name": "ga", "generations": 20, "population": 20, "polish": False}
    result = solve(check_document({**rigid_body, "method": ga})).result()
    assert list(result["nodes"]["controls"]) == ["u"]
    assert result["verification"]["objective"] == pytest.approx(result["energy"], rel=1e-2)


def test_the_fuel_of_the_slew_agrees_with_split_controls(flexible_spacecraft: dict[str, Any]) -> None:
    problem = flexible_spacecraft["problem"]
    problem |= {"final_time": 1.3 * 25.866100388, "objective": {"running": "abs(T)"}}
    split = copy.deepcopy(flexible_spacecraft)
    split["problem"]["model"] |= {"controls": ["P", "N"], "input": [[1, -1], [0, 0]]}
    split["problem"] |= {"bounds": {"P": [0, 5], "N": [0, 5]}, "objective": {"running": "P + N"}}
    method = {"method": {"name": "swcm"}, "options": {"tolerance": 1e-11}}
    lifted, by_hand = (result_of({**one, **method}) for one in (flexible_spacecraft, split))
    assert lifted["objective"] == pytest.approx(by_hand["objective"], abs=1e-8)
    torque = np.subtract(*(by_hand["nodes"]["controls"][name] for name in ("P", "N")))
    np.testing.assert_allclose(lifted["nodes"]["controls"]["T"], torque, atol=1e-4)


def test_an_integral_of_a_magnitude_that_is_bounded_above(rigid_body: dict[str, Any]) -> None:
    """Fuel 1.2 at most: bursts of 0.6, and a (T - a) = 1 gives T = 0.6 + 1/0.6."""
    problem = rigid_body["problem"]
    problem["integrals"] = [{"name": "fuel", "expression": "abs(u)", "bounds": [None, 1.2]}]
    result = result_of({**rigid_body, "method": {"name": "swcm", "J": 5}})
    assert result["success"], result["message"]
    assert result["final_time"] == pytest.approx(0.6 + 1 / 0.6, abs=5e-3)
    assert result["verification"]["integrals"]["fuel"] <= 1.2 * 1.01


@pytest.mark.parametrize("terminal", ["3*fuel/2 - -w*fuel", "(fuel + x_f)*w + 1.5*fuel"])
def test_an_integral_of_a_magnitude_in_the_terminal_cost(rigid_body: dict[str, Any], terminal: str) -> None:
    """Time 2.6, and 2.5 times the price (and the way, 1): bursts of length a with a (2.6 - a) = 1.

    What else it must not exceed is no obstacle: fuel - w of 2 at most, where it is 0.48 times 2.
    """
    problem = rigid_body["problem"]
    problem["model"]["parameters"] = {"m": 1, "w": 1}
    problem |= {
        "final_time": 2.6,
        "integrals": [{"name": "fuel", "expression": "abs(u)"}],
        "objective": {"terminal": terminal},
        "boundary_constraints": [{"expression": "-(w - fuel)", "bounds": [None, 2]}],
    }
    result = result_of({**rigid_body, "method": {"name": "swcm", "J": 5}})
    assert result["success"], result["message"]
    fuel = 2.6 - np.sqrt(2.6**2 - 4)
    assert result["objective"] == pytest.approx(2.5 * fuel + ("x_f" in terminal), rel=1e-3)
    assert result["integrals"]["fuel"] == pytest.approx(fuel, rel=1e-3)
    assert result["warnings"] == []


@pytest.mark.parametrize("phases", [[], [{"name": "forth", "final_time": 1.5}, {"name": "back"}]])
@pytest.mark.parametrize(
    ("cost", "bounds", "fuel"),
    [({"terminal": "-fuel"}, None, 3.0), ({"running": "u^2"}, [2.5, None], 2.5)],
    ids=["as much as possible", "at least"],
)
def test_an_integral_of_which_more_is_asked_for(
    rigid_body: dict[str, Any],
    phases: list[dict[str, Any]],
    cost: dict[str, str],
    bounds: list[float | None] | None,
    fuel: float,
) -> None:
    """A slack would be more of it for nothing, over a whole flight of phases too."""
    problem = rigid_body["problem"]
    problem |= {
        "final_time": 3,
        "integrals": [{"name": "fuel", "expression": "abs(u)", "bounds": bounds}],
        "objective": cost,
        "guess": {"controls": {"u": [1, -1]}},
        "phases": phases,
    }
    result = result_of({**rigid_body, "method": {"name": "swcm", "J": 5}})
    assert result["success"], result["message"]
    assert result["verification"]["integrals"]["fuel"] == pytest.approx(fuel, rel=2e-2)
    assert [item["code"] for item in result["warnings"]] == ["nonsmooth"]


def test_an_integral_far_below_its_bound_is_told_as_it_is(rigid_body: dict[str, Any]) -> None:
    """Nothing draws the slacks down; the fuel of full force over T = 2 is 2, whatever is allowed."""
    rigid_body["problem"]["integrals"] = [{"name": "fuel", "expression": "abs(u)", "bounds": [None, 50]}]
    assert result_of(rigid_body)["integrals"]["fuel"] == pytest.approx(2.0, rel=0.01)


def test_corners_that_stay_are_told(rigid_body: dict[str, Any]) -> None:
    problem = rigid_body["problem"]
    problem |= {
        "final_time": 3,
        "objective": {"running": "u^2 - abs(u)/9 + abs(x)*x", "terminal": "abs(x_f)"},
    }
    result = solve(check_document({**rigid_body, "method": {"name": "swcm"}})).result()
    pointers = [item["pointer"] for item in result["warnings"] if item["code"] == "nonsmooth"]
    assert pointers == ["/problem/objective/terminal", "/problem/objective/running"]


@pytest.mark.parametrize("corner", ["", " + abs(T)"])
def test_the_longest_costs(corner: str) -> None:
    """As many operations as an expression may have, each the left operand of the next."""
    sizes = [
        problem_size(check_document(edited({"/problem/objective": {"running": f"T^2{corner}{tail}"}})))
        for tail in ("", "+T" * (1999 - 2 * bool(corner)))
    ]
    assert sizes[0] == sizes[1]


def test_peaks_of_several_plants(two_plants: dict[str, Any]) -> None:
    """x' = a u over 1: the peak of a u is 1 for the nominal plant, of the stronger one twice as much."""
    problem = two_plants["problem"]
    problem |= {"final_state": {"x": [1, None]}, "objective": {"maximum": "a*u"}}
    for choice, expected in (("nominal", 1.0), ("mean", 1.5), ("worst", 2.0)):
        problem["scenarios"]["objective"] = choice
        assert result_of(two_plants)["objective"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {"/problem/objective/running": "abs(theta)"},
        {"/problem/objective/running": "abs(T) + max(T, 0)"},
        {"/problem/objective/running": "abs(T)", "/problem/bounds/T": [0, 5]},
        {"/problem/objective/running": "abs(T)", "/problem/bounds/T": [None, 5]},
        {
            "/problem/objective/running": "abs(T)",
            "/problem/scenarios": {"cases": [{"name": "soft", "parameters": {"k": 90}}]},
        },
    ],
)
def test_what_refinement_cannot_do_is_refused(changes: dict[str, Any]) -> None:
    (fault,) = faults_of(edited({**changes, "/method/refine": "switching"}))
    assert (fault.pointer, fault.type) == ("/problem/objective/running", "unsupported")


def test_what_refinement_cannot_do_and_no_document_tells_is_said(rigid_body: dict[str, Any]) -> None:
    """A magnitude that is a cost, of a control of which something is said at its end: a slack stays."""
    rigid_body["problem"] |= {
        "final_time": 3,
        "objective": {"running": "abs(u)"},
        "boundary_constraints": [{"expression": "u_f", "bounds": [-0.9, 0.9]}],
    }
    method = {"name": "hermite_simpson", "intervals": 8, "refine": "switching"}
    result = result_of({**rigid_body, "method": method})
    assert "refinement_failed" in [item["code"] for item in result["warnings"]]
    assert "slacks" in result["message"]
