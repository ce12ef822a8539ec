"""The automatic choice: the exact structure where there is one, else an adapted mesh; and it says which."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.catalogue import case_names, load_case
from solvers.solve import solve
from solvers.spec import check_document

SINGLE = [name for name in case_names() if load_case(name)["method"]["name"] != "piecewise"]
"""Problems that are solved as one, which missions in segments are not."""


@pytest.mark.parametrize("name", SINGLE)
def test_every_case_is_solved_and_verified_without_naming_a_method(name: str) -> None:
    document = load_case(name)
    del document["method"]
    solution = solve(check_document(document))
    assert solution.success, solution.message
    reference = document["reference"]["objective"]
    # The robot's published optimum has an error of its own: ours is lower and flies to the target.
    limit = 2e-5 if name == "free_flying_robot" else 1e-8
    assert abs(solution.objective - reference) <= limit
    assert solution.verification.terminal_error is not None
    assert solution.verification.terminal_error <= 1e-8


@pytest.mark.parametrize("span", [3, 10])
def test_a_smooth_control_is_the_best_one_between_the_nodes_too(
    regulator: dict[str, Any], span: float
) -> None:
    """x' = u holds between any nodes; the cost of x^2 + u^2 from x = 1 is tanh(span)."""
    regulator["problem"] |= {"final_time": span, "objective": {"running": "x^2 + u^2"}}
    regulator["problem"] |= {"bounds": {}, "final_state": {}}
    solution = solve(check_document({**regulator, "method": {"name": "auto"}}))
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(np.tanh(span), rel=1e-10)


def test_the_result_says_what_was_done(flexible_spacecraft: dict[str, Any]) -> None:
    method = solve(check_document(flexible_spacecraft)).method
    assert (method["name"], method["L"], method["J"]) == ("swcm", 8, 4)
    assert method["refine"] == "switching"
    assert method["arcs"] == 4


def test_where_no_structure_is_accepted_the_mesh_is_adapted(
    oscillator: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A search for the structure that may not take a single round finds none."""
    monkeypatch.setattr("solvers.refine.search._ROUNDS", 0)
    oscillator["method"] = {"name": "auto", "accuracy": 1e-5}
    solution = solve(check_document(oscillator))
    assert solution.success, solution.message
    assert solution.method["adaptive"]["tolerance"] == 1e-5
    assert solution.verification.tolerances.state_error == 1e-5
