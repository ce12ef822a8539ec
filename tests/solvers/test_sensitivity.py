"""How the optimum changes with the numbers of the document: closed forms, and solving again."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from solvers.catalogue import load_case
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document

METHODS = [
    {"name": "swcm"},
    {"name": "gpm", "nodes": 10, "segments": 6},
    {"name": "hermite_simpson"},
    {"name": "swcm", "refine": "switching"},
]


def slopes(document: dict[str, Any], method: dict[str, Any]) -> dict[str, float]:
    found = solve(check_document({**document, "method": method})).result()["sensitivity"]
    assert found is not None
    return dict(found)


@pytest.mark.parametrize("method", METHODS)
def test_the_minimum_time_of_a_rigid_body(method: dict[str, Any]) -> None:
    """t_f = t_0 + sqrt(2 m x_f (1/a + 1/b)) for -a <= u <= b, here with a = b = m = x_f = 1."""
    document = load_case("rigid_body")
    # As good as zero, and too small for a part of it.
    document["problem"]["initial_state"]["x"] = 5e-324
    found = slopes(document, method)
    expected = {
        "/problem/model/parameters/m": 1.0,
        "/problem/initial_time": 1.0,
        "/problem/final_time/0": 0.0,
        "/problem/final_state/x": 1.0,
        "/problem/initial_state/x": -1.0,
        "/problem/initial_state/x_dot": -1.0,
        "/problem/final_state/x_dot": -1.0,
        "/problem/bounds/u/0": 0.5,
        "/problem/bounds/u/1": -0.5,
    }
    exact = 1e-8 if "refine" in method else 2e-3
    assert {key: found[key] for key in expected} == pytest.approx(expected, abs=exact)


@pytest.mark.parametrize("method", METHODS)
def test_the_brachistochrone_and_its_gravity(method: dict[str, Any]) -> None:
    """The time goes with 1 / sqrt(g), so its slope is -t_f / (2 g)."""
    document = load_case("brachistochrone")
    g = document["problem"]["model"]["parameters"]["g"]
    found = slopes(document, method)
    assert found["/problem/model/parameters/g"] == pytest.approx(-1.8016031 / (2 * g), abs=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_a_limit_that_is_followed(method: dict[str, Any]) -> None:
    """Bryson and Denham: J = 4 / (9 l), whether l stands as a parameter or as the bound itself."""
    found = slopes(load_case("bryson_denham"), method)
    exact = 1e-6 if "refine" in method else 0.5
    assert found["/problem/bounds/x/1"] == pytest.approx(-36.0, abs=exact)
    assert found["/problem/model/parameters/l"] == pytest.approx(-36.0, abs=exact)


@pytest.mark.parametrize("refine", [None, "switching"])
def test_the_slew_solved_again_with_other_numbers(refine: str | None) -> None:
    """Central differences of the minimum time itself, also with respect to ends of velocities."""
    document = load_case("flexible_spacecraft")
    document["method"] = {"name": "swcm", "L": 8, "J": 3, "refine": refine}
    found = solve(check_document(document)).result()["sensitivity"]
    for keys, step in (
        (("model", "parameters", "k"), 0.5),
        (("model", "parameters", "Jb"), 1.0),
        (("final_state", "theta_dot"), 1e-4),
        (("bounds", "T", 1), 0.01),
    ):
        ends = []
        for change in (-step, step):
            changed = copy.deepcopy(document)
            *path, last = keys
            node = changed["problem"]
            for key in path:
                node = node[key]
            node[last] += change
            ends.append(solve(check_document(changed)).objective)
        pointer = "/".join(["/problem", *map(str, keys)])
        assert found[pointer] == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=2e-3, abs=1e-6), pointer


def test_initial_states_change_the_optimum_as_the_costates_say() -> None:
    """dJ*/dx0 is the costate at t0: two ways through the multipliers."""
    document = load_case("min_time_orbit_transfer")
    document["method"] = {"name": "gpm", "nodes": 30, "segments": 2}
    solution: Solution = solve(check_document(document))
    names = solution.problem.states
    first = solution.costates[:, 0] + (solution.costates[:, 1] - solution.costates[:, 0]) * (
        (0.0 - solution.trajectory.nodes[0]) / np.diff(solution.trajectory.nodes[:2])[0]
    )
    assert solution.sensitivity is not None
    for name, value in zip(names, first, strict=True):
        assert solution.sensitivity[f"/problem/initial_state/{name}"] == pytest.approx(value, abs=2e-3)


def test_a_library_model_and_a_sweep_of_all_states() -> None:
    """Parameters that the document leaves to the model have pointers too, and so has the star."""
    document = load_case("rigid_body")
    document["problem"]["model"] = {"kind": "library", "name": "rigid_body"}
    document["problem"]["initial_state"] = {"*": 0}
    found = slopes(document, {"name": "swcm", "refine": "switching"})
    assert found["/problem/model/parameters/m"] == pytest.approx(1.0, abs=1e-8)
    assert found["/problem/initial_state/*"] == pytest.approx(-2.0, abs=1e-8)
