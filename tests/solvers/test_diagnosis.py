"""Why nothing was found: which limits would have to give, and by how much, against closed forms."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solvers.diagnosis import diagnose
from solvers.formulation.scenarios import formulate
from solvers.meshes import meshes_of
from solvers.optimizers.outcome import Limits
from solvers.progress import SilentProgress
from solvers.session import Session
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document
from solvers.start.first_answer import first_answers
from solvers.start.scaling import automatic_scaling
from solvers.status import SolveStatus

Document = dict[str, Any]

METHODS = [
    {"name": "swcm", "L": 8, "J": 2},
    {"name": "gpm", "nodes": 20, "segments": 1},
    {"name": "hermite_simpson", "intervals": 20},
]


def diagnosed(document: Document, method: Document | None = None) -> Solution:
    """The solution of a document that must turn out to be infeasible, with something that has to give."""
    solution = solve(check_document(document if method is None else {**document, "method": method}))
    assert solution.status is SolveStatus.INFEASIBLE
    assert solution.diagnosis
    assert "No feasible point was found" in solution.message
    assert "impossible" not in solution.message
    assert all(item["pointer"] in solution.message for item in solution.diagnosis)
    return solution


@pytest.mark.parametrize("method", METHODS)
def test_the_distance_that_too_little_time_leaves(rigid_body: Document, method: Document) -> None:
    """From rest to rest with |u| <= 1 a body comes T^2 / 4 far; more force would cost more."""
    rigid_body["problem"]["final_time"] = 1.8
    (item,) = diagnosed(rigid_body, method).diagnosis or ()
    assert (item["pointer"], item["name"], item["at"]) == ("/problem/final_state/x", "x", 1.8)
    # Within what the mesh makes of the switch.
    assert item["violation"] == pytest.approx(1.0 - 1.8**2 / 4.0, abs=3e-3)


@pytest.mark.parametrize("method", METHODS)
def test_an_end_behind_a_wall(rigid_body: Document, method: Document) -> None:
    """A path constraint and an end; with a scale of 1/2 the constraint is the dearer one."""
    wall = {"name": "wall", "expression": "x", "bounds": [-0.7, 0.7]}
    rigid_body["problem"]["path_constraints"] = [wall]
    (item,) = diagnosed(rigid_body, method).diagnosis or ()
    assert item["pointer"] == "/problem/final_state/x"
    # Gauss points end before the flight does.
    assert item["violation"] == pytest.approx(0.3, abs=1e-2)


def test_a_path_constraint_that_nothing_meets(rigid_body: Document) -> None:
    """x^2 + 1 <= 1/2 gives s = 1/2 + x^2, the end 1 - x; 2 s + 1 - x is least at x = 1/4."""
    rigid_body["problem"]["path_constraints"] = [{"expression": "x^2 + 1", "bounds": [None, 0.5]}]
    found = {item["pointer"]: item["violation"] for item in diagnosed(rigid_body).diagnosis or ()}
    assert found == {
        "/problem/path_constraints/0": pytest.approx(0.5625, abs=1e-6),
        "/problem/final_state/x": pytest.approx(0.75, abs=1e-6),
    }


def test_where_a_flight_begins_is_a_fact(rigid_body: Document) -> None:
    constraint = {"name": "clear", "expression": "x", "bounds": [0.25, None]}
    rigid_body["problem"]["path_constraints"] = [constraint]
    (item,) = diagnosed(rigid_body).diagnosis or ()
    assert item == {
        "pointer": "/problem/path_constraints/0",
        "name": "clear",
        "violation": pytest.approx(0.25, abs=1e-6),
        "at": 0.0,
    }


def test_a_bound_along_the_flight(regulator: Document) -> None:
    """x' = u - 2, u <= 1, from 1: after one second x = 0 where it should be 1 at least."""
    problem = regulator["problem"]
    problem["model"]["dynamics"] = {"x": "u - 2"}
    problem["bounds"] = {"u": [-1, 1], "x": [1, 1.5]}
    (item,) = diagnosed(regulator).diagnosis or ()
    assert (item["pointer"], item["at"]) == ("/problem/bounds/x", 1.0)
    assert item["violation"] == pytest.approx(1.0, abs=1e-5)


def test_boundary_constraints_against_an_end_that_a_star_says(rigid_body: Document) -> None:
    """x_f >= 3/2 and x_f <= 5/4 at rest: a quarter, of the constraint with the larger scale."""
    problem = rigid_body["problem"]
    problem["final_state"] = {"*": [None, 1.25], "x_dot": 0}
    problem["boundary_constraints"] = [{"name": "far", "expression": "x_f - 2*x_0", "bounds": [1.5, None]}]
    (item,) = diagnosed(rigid_body).diagnosis or ()
    assert item["pointer"] in ("/problem/boundary_constraints/0", "/problem/final_state/*")
    assert item["violation"] == pytest.approx(0.25, abs=1e-6)


def test_an_integral(rigid_body: Document) -> None:
    """Of all flights of 10 s from rest to rest over 1 the least integral of u^2 is 12 / 10^3."""
    integral = {"name": "energy", "expression": "u^2", "bounds": [None, 0.001]}
    rigid_body["problem"]["integrals"] = [integral]
    (item,) = diagnosed(rigid_body, METHODS[1]).diagnosis or ()
    assert (item["pointer"], item["name"], item["at"]) == ("/problem/integrals/0", "energy", None)
    assert item["violation"] == pytest.approx(0.011, abs=1e-6)


def test_the_slew_that_has_too_little_time(flexible_spacecraft: Document) -> None:
    """Against the largest angle that is reached at rest in 20 s, found as an optimum of its own."""
    problem = flexible_spacecraft["problem"]
    problem["final_time"] = 20
    found = {item["pointer"]: item for item in diagnosed(flexible_spacecraft).diagnosis or ()}
    miss = found["/problem/final_state/theta"]
    assert miss["at"] == 20.0
    assert found.keys() <= {"/problem/final_state/theta", "/problem/final_state/alpha"}
    del problem["final_state"]["theta"]
    problem["objective"] = {"terminal": "-theta_f"}
    farthest = -solve(check_document(flexible_spacecraft)).objective
    # The appendage may give a little too, where that brings more than it costs: all of it is less.
    least = np.pi / 6 - farthest
    assert miss["violation"] <= least + 1e-9
    assert miss["violation"] == pytest.approx(least, rel=0.02)


def test_a_coarse_mesh_is_asked_why_before_a_fine_one_is_tried(flexible_spacecraft: Document) -> None:
    """What is missing is that of the fine mesh all the same: all three discretise the same slew."""
    flexible_spacecraft["problem"]["final_time"] = 20
    fine = diagnosed(flexible_spacecraft, {"name": "swcm", "J": 7})
    coarse = diagnosed(flexible_spacecraft, {"name": "swcm", "J": 4})
    other = diagnosed(flexible_spacecraft, {"name": "hermite_simpson", "intervals": 400})
    miss, rough, reference = ((item.diagnosis or [])[0]["violation"] for item in (fine, coarse, other))
    assert abs(miss - reference) < 2e-5
    assert abs(miss - rough) > 5e-6  # it is not the coarse mesh that has the last word
    assert [level["nodes"] for level in fine.convergence] == [17, 129]
    # It is the failing solve of a fine mesh that takes long: 132 iterations, where 30 are for all meshes.
    assert fine.statistics.iterations < 120


def test_a_coarse_mesh_alone_does_not_make_a_document_infeasible(flexible_spacecraft: Document) -> None:
    """25.8669 s are the least on the mesh before the last, 25.8661 s on the last one."""
    flexible_spacecraft["problem"]["final_time"] = 25.8664
    solution = solve(check_document({**flexible_spacecraft, "method": {"name": "swcm", "J": 7}}))
    assert solution.success, solution.message
    assert [level["nodes"] for level in solution.convergence][-1] == 1025


def test_the_end_of_one_scenario_is_named_where_it_stands(rigid_body: Document) -> None:
    problem = rigid_body["problem"]
    heavy = {"name": "heavy", "parameters": {"m": 2}, "final_state": {"x": 9, "x_dot": [None, None]}}
    problem |= {"final_time": 1.9, "scenarios": {"cases": [heavy], "nominal": False}}
    (item,) = diagnosed(rigid_body).diagnosis or ()
    assert item["pointer"] == "/problem/scenarios/cases/0/final_state/x"
    assert (item["name"], item["scenario"]) == ("x", "heavy")
    # Full force all the time: T^2 / (2 m).
    assert item["violation"] == pytest.approx(9.0 - 1.9**2 / 4.0, abs=1e-3)


def test_a_rated_control_is_named_where_it_stands(rigid_body: Document) -> None:
    """The force begins at 0 and may change by 1 a second: at 1 s it is 1 at most, where 2 are asked for."""
    problem = rigid_body["problem"]
    problem |= {"final_time": 1, "final_state": {}, "bounds": {}, "control_rates": {"u": [-1, 1]}}
    problem |= {"initial_control": {"u": 0}, "final_control": {"u": 2}, "objective": {"running": "u^2"}}
    (item,) = diagnosed(rigid_body).diagnosis or ()
    assert item["pointer"] in ("/problem/final_control/u", "/problem/control_rates/u")
    assert item["violation"] == pytest.approx(1.0, abs=1e-6)


def test_polished_genes_are_diagnosed_too(rigid_body: Document) -> None:
    rigid_body["problem"]["final_time"] = 1.2
    (item, *_) = diagnosed(rigid_body, {"name": "ga", "population": 8, "generations": 3}).diagnosis or ()
    assert item["pointer"] == "/problem/final_state/x"
    # The best control of the basis reaches less than the best of all.
    assert item["violation"] >= 1.0 - 1.2**2 / 4.0


@pytest.mark.parametrize("status", [SolveStatus.INFEASIBLE, SolveStatus.ITERATION_LIMIT])
def test_what_has_a_feasible_point_gets_no_diagnosis_but_another_try(
    flexible_spacecraft: Document, status: SolveStatus
) -> None:
    """A solve that gave up although there are feasible points goes on from the one that is found."""
    spec = check_document({**flexible_spacecraft, "method": METHODS[0]})
    problem = formulate(spec.problem).problem
    limits = Limits(time.monotonic() + 60.0, SilentProgress().cancelled)
    session = Session(
        problem=problem,
        scaling=automatic_scaling(problem),
        tolerance=1e-8,
        max_iterations=500,
        limits=limits,
        progress=SilentProgress(),
    )
    good = first_answers(session, meshes_of(spec.method), 1, None, 1.0)[0]
    given_up = replace(good, outcome=replace(good.outcome, status=status))
    again, diagnosis = diagnose(session, lambda _, pointer: pointer, given_up, meshes_of(spec.method)[-1])
    assert diagnosis == []
    assert again.converged
    assert again.objective == pytest.approx(good.objective, abs=1e-6)


def test_what_is_solved_has_no_diagnosis(rigid_body: Document) -> None:
    assert solve(check_document(rigid_body)).result()["diagnosis"] is None


@pytest.mark.parametrize("method", [{"name": "swcm", "J": 2}, {"name": "gpm", "nodes": 10}])
def test_a_control_that_is_given_leaves_more_equations_than_unknowns(method: dict[str, Any]) -> None:
    """A unit mass that is pushed by 1 for a second ends at x = 1/2 with v = 1, and nowhere else."""
    model = {"kind": "first_order", "states": ["x", "v"], "controls": ["u"], "dynamics": {"x": "v", "v": "u"}}
    document = {
        "problem": {
            "model": model,
            "final_time": 1,
            "initial_state": {"*": 0},
            "final_state": {"x": 0.5, "v": 1},
            "bounds": {"u": 1},
            "objective": {"running": "u^2"},
        },
        "method": method,
    }
    met = solve(check_document(document))
    assert met.success, met.message
    assert met.objective == pytest.approx(1.0, abs=1e-6)
    document["problem"]["final_state"]["x"] = 0.75
    missed = solve(check_document(document))
    assert missed.status.value == "infeasible"
    assert {"/problem/bounds/u", "/problem/final_state/x"} & {item["pointer"] for item in missed.diagnosis}
