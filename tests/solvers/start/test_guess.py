"""The default guess, rule by rule, and what a document gives instead."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.errors import DocumentError
from solvers.formulation.stated import stated_problem
from solvers.solve import solve
from solvers.spec import check_document
from solvers.start.guess import Guess

ENDS = np.array([0.0, 1.0])


def guess_of(document: dict[str, Any], **changes: Any) -> Guess:
    document["problem"] |= changes
    return stated_problem(check_document(document).problem).guess


@pytest.mark.parametrize(
    ("bound", "expected"),
    [([4, 9], 6.0), (7, 7.0), ([3, None], 6.0), ([0.2, None], 1.0), ([None, 8], 4.0)],
)
def test_final_time(rigid_body: dict[str, Any], bound: Any, expected: float) -> None:
    assert guess_of(rigid_body, final_time=bound).tf == pytest.approx(expected)


def test_states_go_straight_between_known_ends(rigid_body: dict[str, Any]) -> None:
    states = guess_of(rigid_body, final_state={"x": 4}).states_at(np.array([0.0, 0.25, 1.0]))
    np.testing.assert_allclose(states, [[0, 1, 4], [0, 0, 0]])


def test_a_free_end_takes_the_other_end_else_the_middle_of_the_bounds_else_zero(
    rigid_body: dict[str, Any],
) -> None:
    guess = guess_of(
        rigid_body,
        initial_state={"x": None, "x_dot": None},
        final_state={"x": 3},
        bounds={"x_dot": [1, 5], "u": [-1, 1]},
    )
    np.testing.assert_allclose(guess.states_at(ENDS), [[3, 3], [3, 3]])
    assert np.all(guess_of(rigid_body, final_state={}, bounds={}).states_at(ENDS) == 0.0)


@pytest.mark.parametrize(
    ("bound", "expected"), [([-1, 3], 1.0), ([2, None], 2.0), ([None, -2], -2.0), ([None, 5], 0.0)]
)
def test_controls_start_in_the_middle_or_nearest_to_zero(
    rigid_body: dict[str, Any], bound: Any, expected: float
) -> None:
    guess = guess_of(rigid_body, bounds={"u": bound})
    np.testing.assert_allclose(guess.controls_at(ENDS), [[expected, expected]])


def test_given_lists_are_equally_spaced_or_stand_at_given_times(rigid_body: dict[str, Any]) -> None:
    equal = guess_of(rigid_body, guess={"final_time": 4, "states": {"x": [0, "2*m", 0]}})
    np.testing.assert_allclose(equal.states_at(np.array([0.25, 0.5]))[0], [1, 2])
    timed = guess_of(rigid_body, guess={"final_time": 4, "times": [0, 1, 4], "controls": {"u": [0, 1, 0]}})
    np.testing.assert_allclose(timed.controls_at(np.array([0.125, 0.25, 0.625]))[0], [0.5, 1, 0.5])


def test_the_nodes_of_a_result_are_stretched_over_the_horizon(rigid_body: dict[str, Any]) -> None:
    nodes = {"t": [1, 2, 5], "states": {"x": [0, 1, 2]}, "controls": {"u": [1, 0, -1]}, "costates": {"x": []}}
    guess = guess_of(rigid_body, guess={"from_result": nodes})
    assert guess.tf == 5.0
    np.testing.assert_allclose(guess.states_at(np.array([0.125, 0.25, 1.0]))[0], [0.5, 1.0, 2.0])
    longer = guess_of(rigid_body, guess={"from_result": nodes, "final_time": 9, "states": {"x": [7]}})
    assert longer.tf == 9.0
    np.testing.assert_allclose(longer.states_at(ENDS)[0], [7.0, 7.0])
    np.testing.assert_allclose(longer.controls_at(np.array([0.25]))[0], [0.0])


@pytest.mark.parametrize(
    ("nodes", "pointer"),
    [
        ({}, "/problem/guess/from_result"),
        ({"t": [0, 1], "states": {"y": [0, 1]}}, "/problem/guess/from_result/states/y"),
        ({"t": [0, 1], "states": {"x": [0]}}, "/problem/guess/from_result/states/x"),
        ({"t": [0, 0]}, "/problem/guess/from_result/t/1"),
        ({"t": [0, 1], "controls": {"u": [0, None]}}, "/problem/guess/from_result/controls/u/1"),
    ],
)
def test_nodes_that_are_not_nodes_are_refused(
    rigid_body: dict[str, Any], nodes: dict[str, Any], pointer: str
) -> None:
    with pytest.raises(DocumentError) as caught:
        guess_of(rigid_body, guess={"from_result": nodes})
    assert [fault.pointer for fault in caught.value.faults] == [pointer]


def test_a_result_of_one_method_starts_another(flexible_spacecraft: dict[str, Any]) -> None:
    flexible_spacecraft["method"] = {"name": "swcm", "J": 3}
    first = solve(check_document(flexible_spacecraft))
    flexible_spacecraft["method"] = {"name": "hermite_simpson", "intervals": 40}
    cold = solve(check_document(flexible_spacecraft))
    flexible_spacecraft["problem"]["guess"] = {"from_result": first.result()["nodes"]}
    started = solve(check_document(flexible_spacecraft))
    assert started.objective == pytest.approx(cold.objective, abs=1e-6)
    assert started.statistics.iterations < cold.statistics.iterations


@pytest.mark.parametrize("method", [{"name": "swcm", "J": 5}, {"name": "gpm", "nodes": 5, "segments": 20}])
def test_an_earlier_answer_starts_another_mesh_and_other_parameters(
    flexible_spacecraft: dict[str, Any], method: dict[str, Any]
) -> None:
    earlier = solve(check_document({**flexible_spacecraft, "method": {"name": "swcm", "J": 4}}))
    flexible_spacecraft["problem"]["model"]["parameters"]["k"] = 101
    document = {**flexible_spacecraft, "method": method}
    cold = solve(check_document(document))
    named = check_document({**document, "warm_start": "0197a0b0-0000-7000-8000-000000000000"})
    warm = solve(named, earlier=earlier.trajectory)
    assert warm.objective == pytest.approx(cold.objective, abs=1e-5)
    assert warm.statistics.iterations < cold.statistics.iterations
    assert len(warm.convergence) == 1


def test_an_earlier_answer_that_is_not_there_is_refused(rigid_body: dict[str, Any]) -> None:
    with pytest.raises(DocumentError) as caught:
        solve(check_document({**rigid_body, "warm_start": "0197a0b0-0000-7000-8000-000000000000"}))
    assert [fault.pointer for fault in caught.value.faults] == ["/warm_start"]
