"""Predictions: the optimum of one collocation over everything, soft bounds, what is known beforehand."""

from __future__ import annotations

import copy
import math
import time
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from solvers.optimizers.outcome import Limits
from solvers.piecewise.predict import Predictor
from solvers.piecewise.reference import Reference
from solvers.piecewise.rehearsal import Rehearsal
from solvers.piecewise.setup import Setup
from solvers.sizes import problem_size
from solvers.solve import solve
from solvers.spec import check_document
from solvers.status import SolveStatus
from tests.solvers.piecewise.documents import CART, PENDULUM, changed

LIMITS = Limits(math.inf, lambda: False)


def setup_of(document: dict[str, Any]) -> Setup:
    return Setup.of(check_document(document))


def first(document: dict[str, Any], start: list[float] | None = None) -> Reference:
    setup = setup_of(document)
    predictor = Predictor(setup)
    if start is None:
        return predictor.first(LIMITS)
    return predictor.predict(0, np.array(start), setup.problem.initial_time[0], LIMITS)


@pytest.mark.parametrize("whole", [PENDULUM, CART], ids=["time", "state"])
def test_a_horizon_to_the_end_gives_the_optimum_of_the_whole(whole: dict[str, Any]) -> None:
    document = copy.deepcopy(whole)
    document["method"] |= {"lookahead": 100, "nodes": 15, "smoothing": 1e-9, "margins": {}}
    prediction = first(document)
    assert prediction.status is SolveStatus.CONVERGED
    document["method"] = {"name": "hermite_simpson", "intervals": 150}
    assert prediction.objective == pytest.approx(solve(check_document(document)).objective, rel=1e-3)


def test_states_that_no_control_reaches_are_known_beforehand() -> None:
    setup = setup_of(PENDULUM)
    names = [setup.problem.states[index] for index in setup.model.driven]
    assert names == ["angle", "rate"]
    prediction = first(PENDULUM)
    np.testing.assert_allclose(prediction.states[2], 0.3 + 0.5 * prediction.times, rtol=1e-12)
    tether = setup_of(
        {
            "problem": {
                "model": {"kind": "library", "name": "edt"},
                "final_time": 3000,
                "initial_state": {"*": 0, "p": 7178137},
                "bounds": {"I": [0, 0.4]},
                "objective": {"running": "power"},
            },
            "method": {"name": "piecewise", "segments": {"by": "time", "length": 3000}},
        }
    ).model
    assert [tether.problem.states[index] for index in tether.driven] == [
        "alpha",
        "alpha_dot",
        "beta",
        "beta_dot",
    ]
    assert tether.signals == ("Bx", "By", "Bz")


def test_a_start_outside_its_bounds_is_brought_back() -> None:
    prediction = first(PENDULUM, [1.0, -0.9, 0.3])
    assert prediction.status is SolveStatus.CONVERGED
    rate = prediction.states[1]
    assert rate[0] == -0.9
    assert rate[-1] >= -0.68


def test_a_start_that_cannot_be_brought_back_in_time_is_no_failure() -> None:
    prediction = first(PENDULUM, [1.0, -4.0, 0.3])
    assert prediction.status is SolveStatus.CONVERGED
    assert prediction.states[1, 7] < -0.7  # in the second half, where bounds are hard at first
    assert prediction.states[1, -1] >= -0.68


def test_soft_bounds_are_exact_where_they_can_be_held() -> None:
    rate = first(PENDULUM).states[1]
    assert rate.min() >= -0.67 - 1e-6  # the bound less its margin


def test_the_segment_ends_where_the_state_says() -> None:
    prediction = first(CART)
    assert prediction.states[0, -1] == pytest.approx(2.0, abs=1e-9)
    assert prediction.times[-1] == pytest.approx(2.0, abs=0.02)  # x = t^2/2 at full thrust


@pytest.mark.parametrize("document", [PENDULUM, CART], ids=["time", "state"])
def test_validate_knows_the_size_of_the_program(document: dict[str, Any]) -> None:
    prediction, size = first(document), problem_size(check_document(document))
    assert (size.variables, size.constraints) == (prediction.variables, prediction.constraints)


def test_the_next_prediction_starts_from_the_simulated_tracker() -> None:
    predictor = Predictor(setup_of(PENDULUM))
    reference = predictor.first(LIMITS)
    start = reference.states[:, 0] + [0.02, -0.01, 0.0]
    following = predictor.following(reference, start, LIMITS)
    assert following.index == 1
    assert following.times[0] == reference.times[-1]
    # The tracker is back on the reference by then.
    np.testing.assert_allclose(following.states[:2, 0], reference.end[:2], atol=1e-2)
    assert not np.array_equal(following.states[:2, 0], reference.end[:2])


def test_the_tracker_is_rehearsed_on_the_whole_simple_model() -> None:
    setup = setup_of(PENDULUM)
    reference = Predictor(setup).first(LIMITS)
    start = reference.states[:, 0] + [0.02, -0.01, 0.1]
    rehearsal = Rehearsal(setup.model)
    rehearsal.begin(start, reference.times)
    track = setup.tracker.follow(reference, setup.tracker.gains(reference), rehearsal, start)
    state = start
    for t0, t1, u0, u1 in zip(track.times[:-1], track.times[1:], track.before, track.after, strict=True):

        def rate(t: float, x: Any, t0: float = t0, t1: float = t1, u0: Any = u0, u1: Any = u1) -> list[float]:
            torque = float(np.interp(t, [t0, t1], [u0[0], u1[0]]))
            return [x[1], torque - x[0] + 0.1 * math.sin(x[2]), 0.5]

        state = solve_ivp(rate, (t0, t1), state, rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(track.states[-1], state, rtol=0, atol=1e-6)


def test_the_chapter_takes_half_of_the_last_error() -> None:
    predictor = Predictor(setup_of(changed(PENDULUM, "/method/scheme", "chapter")))
    one = predictor.first(LIMITS)
    two = predictor.following(one, one.states[:, 0], LIMITS)
    np.testing.assert_allclose(two.states[:, 0], one.end, rtol=1e-12)
    off = np.array([0.02, -0.01, 0.0])
    three = predictor.following(two, one.end + off, LIMITS)
    np.testing.assert_allclose(three.states[:, 0], two.end + off / 2, rtol=0, atol=1e-9)


def test_a_prediction_stops_at_its_deadline() -> None:
    predictor = Predictor(setup_of(PENDULUM))
    late = predictor.predict(0, np.array([1.0, 0.0, 0.3]), 0.0, Limits(time.monotonic() - 1, lambda: False))
    assert late.status is SolveStatus.TIME_LIMIT
