"""Answers against closed forms and the tables of the wavelet paper (Zhang, Feng, Tang, Macdonald 2014).

The paper's flexible spacecraft has no closed form; its minimum time 25.866100388133 s and the switches come
from a multi-arc solve with the switching times as unknowns, by another program.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document

MINIMUM_TIME = 25.866100388133
SWITCHES = [11.632730580, 12.933050194, 14.233369808]


def answer(document: dict[str, Any], **method: Any) -> Solution:
    return solve(check_document({**document, "method": method}))


# Table 1 of the paper: 2.0068, 2.0032, 2.0023 by its collocation at all points.
@pytest.mark.parametrize(
    ("J", "printed", "limit"), [(1, 2.0068, 5.3e-3), (2, 2.0032, 1.4e-3), (3, 2.0023, 3.4e-4)]
)
def test_rigid_body_by_spline_wavelets(
    rigid_body: dict[str, Any], J: int, printed: float, limit: float
) -> None:
    solution = answer(rigid_body, name="swcm", J=J)
    assert solution.success
    # A spline's second derivative is piecewise linear: it can never undercut the true minimum time.
    assert 0.0 < solution.objective - 2.0 <= limit
    assert solution.objective < printed


@pytest.mark.parametrize(("nodes", "printed"), [(19, "2.0043"), (35, "2.0013"), (67, "2.0004")])
def test_rigid_body_by_gauss_points_to_the_last_printed_digit(
    rigid_body: dict[str, Any], nodes: int, printed: str
) -> None:
    assert f"{answer(rigid_body, name='gpm', nodes=nodes).objective:.4f}" == printed


@pytest.mark.parametrize(("J", "limit"), [(4, 1e-3), (5, 6e-4)])
def test_flexible_spacecraft_by_spline_wavelets(
    flexible_spacecraft: dict[str, Any], J: int, limit: float
) -> None:
    solution = answer(flexible_spacecraft, name="swcm", J=J)
    assert solution.success
    assert abs(solution.objective - MINIMUM_TIME) <= limit
    np.testing.assert_allclose(solution.switching["T"]["times"], SWITCHES, atol=26 / 2**J / 8)
    assert solution.switching["T"]["levels"] == [5.0, -5.0, 5.0, -5.0]
    assert solution.switching["T"]["arcs"] == ["upper", "lower", "upper", "lower"]


@pytest.mark.parametrize(
    ("method", "limit"),
    [
        ({"name": "gpm", "nodes": 131}, 2.2e-3),
        ({"name": "gpm", "nodes": 259}, 4e-4),
        ({"name": "hermite_simpson", "intervals": 65}, 1e-3),
    ],
)
def test_flexible_spacecraft_by_polynomials(
    flexible_spacecraft: dict[str, Any], method: dict[str, Any], limit: float
) -> None:
    solution = answer(flexible_spacecraft, **method)
    assert abs(solution.objective - MINIMUM_TIME) <= limit


def test_polynomial_controls_leave_their_bounds_between_nodes_and_are_not_called_verified(
    flexible_spacecraft: dict[str, Any],
) -> None:
    solution = answer(flexible_spacecraft, name="hermite_simpson", intervals=65)
    assert solution.verification.max_bound_violation > 0.1
    assert solution.status.value == "unverified"
    assert "bound" in solution.message


def test_the_returned_command_steers_an_independent_integration_to_the_target(
    flexible_spacecraft: dict[str, Any],
) -> None:
    """The linear control of 131 points, flown by a plain loop over its intervals."""
    trajectory = answer(flexible_spacecraft, name="swcm").trajectory
    Jb, R, m, L, k = 440.0, 2.5, 10.0, 5.0, 100.0
    tau = trajectory.breakpoints
    times, torque = trajectory.time(tau), trajectory.controls_at(tau)[0]
    assert np.all(np.abs(torque) <= 5.0)

    def rate(t: float, x: np.ndarray, left: int) -> list[float]:
        _, a, w, v = x
        coupling = 2 * m * (L**2 + R * L * np.cos(a))
        mass = np.array(
            [[Jb + 2 * m * (R**2 + L**2 + 2 * R * L * np.cos(a)), coupling], [coupling, 2 * m * L**2]]
        )
        fraction = (t - times[left]) / (times[left + 1] - times[left])
        u = torque[left] + fraction * (torque[left + 1] - torque[left])
        sine = 2 * m * R * L * np.sin(a)
        load = np.array([u + sine * v * w + sine * (w + v) * v, -sine * w * w - 2 * k * a])
        return [w, v, *np.linalg.solve(mass, load)]

    state = np.zeros(4)
    for left in range(tau.size - 1):
        flown = solve_ivp(rate, times[left : left + 2], state, args=(left,), rtol=1e-11, atol=1e-13)
        state = flown.y[:, -1]
    miss = np.abs(state - [np.pi / 6, 0, 0, 0])
    assert miss.max() <= 1e-4
    reported = answer(flexible_spacecraft, name="swcm").verification
    np.testing.assert_allclose(
        miss, [reported.states[name].terminal_error for name in reported.states], atol=1e-9
    )


def test_a_fine_level_starts_from_the_answer_of_a_coarse_one(flexible_spacecraft: dict[str, Any]) -> None:
    solution = answer(flexible_spacecraft, name="swcm", J=6)
    assert [level["nodes"] for level in solution.convergence] == [8 * 2**3 + 1, 8 * 2**6 + 1]
    assert solution.convergence[0]["objective"] != solution.objective
    assert solution.success


@pytest.mark.parametrize("level", [9, 10])
def test_a_mesh_of_thousands_of_points(flexible_spacecraft: dict[str, Any], level: int) -> None:
    solution = answer(flexible_spacecraft, name="swcm", J=level)
    assert solution.success
    assert abs(solution.objective - MINIMUM_TIME) <= 1e-5
    np.testing.assert_allclose(solution.switching["T"]["times"], SWITCHES, atol=1e-3)
    assert solution.verification.max_bound_violation == 0.0
