"""The default guess, rule by rule, and what a document gives instead."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.guess import Guess
from solvers.problem import OptimalControlProblem
from solvers.spec import check_document

ENDS = np.array([0.0, 1.0])


def guess_of(document: dict[str, Any], **changes: Any) -> Guess:
    document["problem"] |= changes
    return OptimalControlProblem.from_spec(check_document(document).problem).guess


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
