"""The compiled integrator against closed forms, and against SciPy."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import DOP853, RK45, solve_ivp

from solvers.piecewise.flow import Flow, RunawayError, Scheme

Vector = NDArray[np.float64]


def rate_of(states: int, write: object) -> ca.Function:
    x, u, t, held = ca.SX.sym("x", states), ca.SX.sym("u", 1), ca.SX.sym("t"), ca.SX.sym("held", 1)
    return ca.Function("rate", [x, u, t, held], [ca.vertcat(*write(x, u, t, held))])  # type: ignore[operator]


def test_a_ramp_of_the_control_is_integrated_exactly() -> None:
    flow = Flow(rate_of(2, lambda x, u, t, held: (x[1], u[0] + held[0])), 1e-10)
    end = flow.fly(np.array([1.0, 2.0]), 3.0, 5.0, np.array([4.0]), np.array([-2.0]), np.array([0.5]))
    # u = 4 - 3 s over s = t - 3, plus 0.5 that is held.
    np.testing.assert_allclose(end, [1 + 2 * 2 + 4.5 * 2 - 3 * 8 / 6, 2 + 4.5 * 2 - 3 * 4 / 2], rtol=1e-13)


@pytest.mark.parametrize(("scheme", "rtol"), [(DOP853, 1e-6), (DOP853, 1e-9), (DOP853, 1e-11), (RK45, 1e-6)])
def test_the_tolerance_is_kept(scheme: Scheme, rtol: float) -> None:
    rate = rate_of(2, lambda x, u, t, held: (x[1], -ca.sin(x[0]) + u[0] * ca.cos(3 * t)))
    flow = Flow(rate, rtol, scheme=scheme)
    start, u = np.array([1.0, 0.0]), np.array([0.3])
    end = flow.fly(start, 0.0, 20.0, u, u, np.zeros(1))
    exact = solve_ivp(
        lambda t, x: [x[1], -np.sin(x[0]) + 0.3 * np.cos(3 * t)],
        (0, 20),
        start,
        method="DOP853",
        rtol=1e-13,
        atol=1e-14,
    ).y[:, -1]
    assert np.abs(end - exact).max() < 200 * rtol


def test_what_rides_along_does_not_shorten_steps() -> None:
    counted = []

    def steps(watched: int | None) -> Vector:
        flow = Flow(rate_of(2, lambda x, u, t, held: (-x[0], ca.sin(500 * t))), 1e-10, watched)
        step = flow._step
        flow._step = lambda *values: counted.append(1) or step(*values)  # type: ignore[assignment,func-returns-value]
        return flow.fly(np.array([1.0, 0.0]), 0.0, 1.0, np.zeros(1), np.zeros(1), np.zeros(1))

    assert steps(1)[0] == pytest.approx(np.exp(-1), rel=1e-9)
    few = len(counted)
    counted.clear()
    steps(None)
    assert few < 20 < len(counted)


def test_a_state_that_runs_away_is_told() -> None:
    flow = Flow(rate_of(1, lambda x, u, t, held: (x[0] ** 2,)), 1e-9)
    with pytest.raises(RunawayError) as runaway:
        flow.fly(np.array([1.0]), 0.0, 2.0, np.zeros(1), np.zeros(1), np.zeros(1))
    assert runaway.value.time == pytest.approx(1.0, abs=1e-3)


def test_a_rate_that_is_no_number_is_told() -> None:
    flow = Flow(rate_of(1, lambda x, u, t, held: (ca.sqrt(0.5 - t),)), 1e-9)
    with pytest.raises(RunawayError):
        flow.fly(np.array([1.0]), 0.0, 2.0, np.zeros(1), np.zeros(1), np.zeros(1))
