"""Why a flight of phases has no feasible point: what would have to give, against closed forms."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from solvers.phases.solution import PhasedSolution
from solvers.solve import solve
from solvers.spec import check_document
from tests.solvers.conftest import INTEGRATOR
from tests.solvers.phases.test_phases import GPM, SLIDE_AND_ROLL

Document = dict[str, Any]

METHODS = ({"name": "swcm", "J": 4}, GPM, {"name": "hermite_simpson", "intervals": 24}, {"name": "auto"})


def diagnosed(document: Document, method: Document = GPM) -> list[Any]:
    """The diagnosis of a document that has no feasible point."""
    solution = solve(check_document({**document, "method": method}))
    assert isinstance(solution, PhasedSolution)
    assert solution.status.value == "infeasible", solution.message
    assert all(item["pointer"] in solution.message for item in solution.diagnosis or ())
    return list(solution.diagnosis or ())


@pytest.fixture
def document() -> Document:
    """x' = u, |u| <= 1, by way of 0.3 at 0.5 s to 0.6 at 1 s: easily done."""
    return {
        "problem": {
            "model": copy.deepcopy(INTEGRATOR),
            "final_time": 1,
            "initial_state": {"x": 0},
            "final_state": {"x": 0.6},
            "bounds": {"u": [-1, 1]},
            "objective": {"running": "u^2"},
            "phases": [{"name": "out", "final_time": 0.5, "final_state": {"x": 0.3}}, {"name": "on"}],
        }
    }


@pytest.mark.parametrize("method", METHODS, ids=[method["name"] for method in METHODS])
def test_a_waypoint_that_is_too_far(document: Document, method: Document) -> None:
    """At most 0.5 in half a second where 0.75 is wanted; from there on everything can be done."""
    document["problem"]["phases"][0]["final_state"] = {"x": 0.75}
    (item,) = diagnosed(document, method)
    assert item == {
        "pointer": "/problem/phases/0/final_state/x",
        "name": "x",
        "violation": pytest.approx(0.25, abs=1e-6),
        "at": 0.5,
    }


def test_an_end_that_a_slow_phase_does_not_reach(document: Document) -> None:
    """The second phase is slow: from 0.3, where a wall is, to 0.4, where 0.6 is wanted."""
    document["problem"]["phases"][1]["bounds"] = {"u": [0, 0.2]}
    document["problem"]["phases"][0]["path_constraints"] = [
        {"name": "wall", "expression": "x", "bounds": [None, 0.3]}
    ]
    found = {item["pointer"]: item for item in diagnosed(document)}
    assert set(found) == {"/problem/final_state/x"}
    assert found["/problem/final_state/x"]["violation"] == pytest.approx(0.2, abs=1e-6)
    assert found["/problem/final_state/x"]["at"] == 1.0


def test_a_common_limit_stands_there_once(document: Document) -> None:
    """x >= 1/4 all the time, which begins at 0: by 1/4, and in the second phase by nothing."""
    document["problem"]["path_constraints"] = [{"name": "clear", "expression": "x", "bounds": [0.25, None]}]
    (item,) = diagnosed(document, METHODS[2])
    assert (item["pointer"], item["name"], item["at"]) == ("/problem/path_constraints/0", "clear", 0.0)
    assert item["violation"] == pytest.approx(0.25, abs=1e-6)


def test_what_counts_over_the_whole_flight(document: Document) -> None:
    """The integral of u is x_f - x_0 = 0.6, where 0.5 is the most: both share the 0.1, or one has it all."""
    document["problem"]["integrals"] = [{"name": "way", "expression": "u", "bounds": [None, 0.5]}]
    found = {item["pointer"]: item["violation"] for item in diagnosed(document)}
    assert found.keys() <= {"/problem/integrals/0", "/problem/final_state/x"}
    assert sum(found.values()) == pytest.approx(0.1, abs=1e-6)
    del document["problem"]["integrals"]
    apart = {"name": "apart", "expression": "2*(x_f - x_0)", "bounds": 1.6}
    document["problem"]["boundary_constraints"] = [apart]
    (item,) = diagnosed(document)
    # The one with the larger scale is the cheaper one.
    assert (item["pointer"], item["name"]) == ("/problem/boundary_constraints/0", "apart")
    assert item["violation"] == pytest.approx(0.4, abs=1e-6)


def test_where_a_later_phase_is_to_begin(document: Document) -> None:
    """The first phase ends at 0.3, a jump adds 0.05, and the second one says that it begins at 0.45."""
    document["problem"]["phases"][1]["initial_state"] = {"x": 0.45}
    document["problem"]["links"] = [{"from": "out", "to": "on", "jump": {"x": "x_f + 0.05"}}]
    (item,) = diagnosed(document)
    assert item["pointer"] in ("/problem/phases/0/final_state/x", "/problem/phases/1/initial_state/x")
    assert item["violation"] == pytest.approx(0.1, abs=1e-6)
    assert item["at"] == 0.5


def test_a_phase_with_a_model_of_its_own() -> None:
    """y'' = F, |F| <= 4 from rest to rest in a second goes 1 far; x comes to 1/2 at most, y is to be 2."""
    document = copy.deepcopy(SLIDE_AND_ROLL)
    document["problem"]["bounds"] = {"u": [-0.5, 0.5]}
    document["problem"]["phases"][1] |= {"bounds": {"F": [-4, 4]}, "final_state": {"y": 2, "y_dot": 0}}
    found = {item["pointer"]: item["violation"] for item in diagnosed(document)}
    assert set(found) == {"/problem/phases/1/final_state/y"}
    assert found["/problem/phases/1/final_state/y"] == pytest.approx(0.5, abs=1e-2)
