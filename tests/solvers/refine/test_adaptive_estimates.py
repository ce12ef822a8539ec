"""The estimates that steer adaptive meshes, against integrations and closed forms."""

from __future__ import annotations

import copy
import dataclasses
import time
from typing import Any

import numpy as np
import pytest

from solvers.bases.graded import GradedKnots
from solvers.catalogue import load_case
from solvers.refine import adaptive_gauss, adaptive_intervals, adaptive_splines
from solvers.refine.adaptive import MeshLimit
from solvers.refine.adaptive_gauss import GaussMesh
from solvers.refine.adaptive_intervals import IntervalMesh
from solvers.refine.adaptive_optimality import suboptimality
from solvers.refine.adaptive_splines import SplineMesh
from solvers.refine.jumps import Jump, jumps_of
from solvers.refine.residual import arc_errors, flight_errors
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document
from solvers.switching import find_switching
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Tolerances
from solvers.verification.verify import verify
from tests.solvers.refine.estimates import assert_estimate_is_true

CASES = [
    "brachistochrone",
    "bryson_denham",
    "flexible_spacecraft",
    "free_flying_robot",
    "goddard",
    "min_time_orbit_transfer",
    "rigid_body",
    "two_mass_spring",
    "van_der_pol",
]
METHODS = [
    {"name": "swcm", "J": 3},
    {"name": "gpm", "nodes": 20},
    {"name": "hermite_simpson", "intervals": 30},
]


def answer(document: dict[str, Any], **method: Any) -> Solution:
    return solve(check_document({**copy.deepcopy(document), "method": method}))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", METHODS, ids=lambda method: str(method["name"]))
def test_the_estimate_is_the_error_that_the_integration_finds(case: str, method: dict[str, Any]) -> None:
    assert_estimate_is_true(answer(load_case(case), **method).verification, 2.0)


def test_the_flight_over_all_arcs_is_estimated_without_flying(oscillator: dict[str, Any]) -> None:
    for method in ({"name": "swcm", "L": 5, "J": 3}, {"name": "hermite_simpson", "intervals": 16}):
        solution = answer(oscillator, **method)
        estimate = flight_errors(
            solution.problem, solution.trajectory, arc_errors(solution.problem, solution.trajectory)
        )
        true = solution.verification.terminal_error
        assert estimate is not None
        assert true is not None
        assert np.abs(estimate).max() == pytest.approx(true, rel=0.1)


def test_ends_are_right_to_fourth_order_where_the_equations_hold_in_the_mean(
    oscillator: dict[str, Any],
) -> None:
    """Held at the knots, the same splines end off by the square of the step."""
    misses = [
        [flown(oscillator, {"name": "swcm", "L": 5, "J": J, **more})[1] for J in (0, 1, 2)]
        for more in ({}, {"adaptive": {"tolerance": 1, "max_level": 2}})
    ]
    at_knots, in_the_mean = np.log2(np.divide([row[:-1] for row in misses], [row[1:] for row in misses]))
    np.testing.assert_allclose(at_knots, 2.0, atol=0.2)
    assert np.all(in_the_mean > 3.7)


def test_a_jump_is_placed_by_its_integral() -> None:
    """To the square of the step; where the control crosses its middle is off by a part of the step."""
    case = load_case("two_mass_spring")
    solution = answer(case, name="swcm", J=4)
    width = float(np.diff(solution.trajectory.breakpoints).max())
    duration = case["reference"]["final_time"]
    expected = np.array(case["reference"]["switching"]["u"]) / duration
    found = jumps_of(solution.problem, solution.trajectory)
    np.testing.assert_allclose([jump.place for jump in found], expected, rtol=0, atol=2 * width**2)
    assert all(jump.start < jump.place < jump.stop <= jump.start + 6 * width for jump in found)
    crossings = np.array(find_switching(solution.problem, solution.trajectory)["u"]["times"])
    assert np.abs(crossings / duration - expected).max() > 2 * width**2


def test_a_flight_whose_errors_grow_beyond_measure_is_not_estimated(oscillator: dict[str, Any]) -> None:
    problem = oscillator["problem"]
    problem["model"]["stiffness"] = [[-1]]
    problem["final_time"] = 40
    solution = answer(oscillator, name="swcm", L=5, J=4)
    errors = arc_errors(solution.problem, solution.trajectory)
    assert flight_errors(solution.problem, solution.trajectory, errors) is None


def test_the_gap_of_a_slope_in_the_place_of_a_switch(rigid_body: dict[str, Any]) -> None:
    """t_f = 2 in closed form, switching function t - 1: the gap is the time that the mesh loses."""
    lost = []
    for level in (2, 3, 4, 5):
        solution = answer(rigid_body, name="swcm", J=level)
        gap = suboptimality(solution.problem, solution.trajectory, solution.costates)
        breaks = solution.trajectory.time(solution.trajectory.breakpoints)
        away = (breaks[1:] < 0.8) | (breaks[:-1] > 1.2)
        assert gap[away].max() < 1e-6
        lost.append([solution.objective - 2.0, gap.sum()])
    loss, gaps = np.transpose(lost)
    assert np.all((gaps / loss > 0.2) & (gaps / loss < 5.0))


def test_without_bounded_controls_there_is_no_gap(regulator: dict[str, Any]) -> None:
    solution = answer(regulator, name="swcm", J=2)
    np.testing.assert_array_equal(
        suboptimality(solution.problem, solution.trajectory, solution.costates), 0.0
    )


def flown(document: dict[str, Any], method: dict[str, Any]) -> tuple[Solution, float]:
    document = {**document, "method": method, "options": {"tolerance": 1e-12}}
    solution = solve(check_document(document))
    verification = verify(solution.problem, solution.trajectory, Tolerances(), time.monotonic() + 20)
    assert verification.terminal_error is not None
    return solution, verification.terminal_error


def test_straight_lines_that_are_nearest_in_the_mean_do_not_err_to_one_side(
    regulator: dict[str, Any],
) -> None:
    """Lines through the control's own values end off by the square of the step, these by its fourth power."""
    regulator["problem"]["model"]["dynamics"]["x"] = "u - x^3"
    plain = [flown(regulator, {"name": "swcm", "L": 5, "J": J})[1] for J in (1, 2, 3)]
    nearest = [
        flown(
            regulator,
            {"name": "swcm", "L": 5, "J": J, "adaptive": {"tolerance": 1, "max_level": J}},
        )[1]
        for J in (1, 2, 3)
    ]
    np.testing.assert_allclose(np.log2(np.array(plain[:-1]) / plain[1:]), 2.0, atol=0.2)
    assert np.all(np.log2(np.array(nearest[:-1]) / nearest[1:]) > 3.5)
    assert nearest[0] < plain[0] / 10


def test_the_objective_converges_with_order_four_where_the_cost_sees_the_control_between_nodes(
    regulator: dict[str, Any],
) -> None:
    exact = np.tanh(1) / 2  # x' = u, integral of (x^2 + u^2) / 2
    errors = []
    for J in (0, 1, 2):
        method = {"name": "swcm", "L": 5, "J": J, "adaptive": {"tolerance": 1, "max_level": J}}
        errors.append(abs(flown(regulator, method)[0].objective - exact))
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 3.8)


@pytest.fixture(scope="module")
def smooth() -> Trajectory:
    return answer(load_case("van_der_pol"), name="gpm", nodes=8, segments=2).trajectory


@pytest.fixture(scope="module")
def kinked() -> Trajectory:
    return answer(load_case("rigid_body"), name="gpm", nodes=8, segments=1).trajectory


def test_where_coefficients_fall_fast_nodes_are_added(smooth: Trajectory) -> None:
    mesh = GaussMesh(np.array([0.0, 0.5, 1.0]), (8, 8))
    errors = np.where(smooth.breakpoints[:-1] < 0.5, 1e-3, 1e-9)
    finer = mesh.refined(smooth, errors, 1e-6)
    np.testing.assert_array_equal(finer.breaks, mesh.breaks)
    assert finer.counts[0] > 8
    assert finer.counts[1] == 8


def test_where_they_do_not_the_segment_is_cut(kinked: Trajectory) -> None:
    finer = GaussMesh(np.array([0.0, 1.0]), (8,)).refined(
        kinked, np.full(kinked.breakpoints.size - 1, 1e-2), 1e-6
    )
    assert finer.breaks.size > 2
    assert set(finer.counts) == {8}


def test_a_jump_gets_a_segment_of_one_node_which_becomes_shorter(kinked: Trajectory) -> None:
    mesh, errors = GaussMesh(np.array([0.0, 1.0]), (8,)), np.full(kinked.breakpoints.size - 1, 1e-2)
    cut = mesh.refined(kinked, errors, 1e-6, [Jump(0.5, 0.3, 0.7, 1e4)])
    np.testing.assert_allclose(cut.breaks, [0.0, 0.475, 0.525, 1.0])
    assert cut.counts == (8, 1, 8)
    # While other errors are large its place may still move.
    seen, on_it = [Jump(0.51, 0.4, 0.6, 16.0)], dataclasses.replace(kinked, breakpoints=cut.breaks)
    waiting = cut.refined(on_it, np.array([1e-5, 1e-9, 1e-9]), 1e-6, seen)
    assert {0.475, 0.525} < set(np.round(waiting.breaks, 12).tolist())
    shorter = cut.refined(on_it, np.full(3, 1e-9), 1e-6, seen)
    assert shorter.counts == (8, 1, 8)
    assert np.mean(shorter.breaks[1:3]) == pytest.approx(0.51)
    assert 0.05 / 8 < np.diff(shorter.breaks)[1] < 0.05 / 4


def test_segments_whose_error_is_negligible_are_joined(smooth: Trajectory) -> None:
    joined = GaussMesh(np.array([0.0, 0.5, 1.0]), (8, 8)).refined(
        smooth, np.full(smooth.breakpoints.size - 1, 1e-12), 1e-6
    )
    assert joined.breaks.tolist() == [0.0, 1.0]


def test_too_many_nodes_are_refused(smooth: Trajectory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adaptive_gauss, "MAX_NODES", 20)
    errors = np.full(smooth.breakpoints.size - 1, np.inf)
    with pytest.raises(MeshLimit, match="more than 20 nodes"):
        GaussMesh(np.array([0.0, 0.5, 1.0]), (8, 8)).refined(smooth, errors, 1e-9)


def test_an_interval_is_cut_as_often_as_its_error_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    trajectory = answer(load_case("van_der_pol"), name="hermite_simpson", intervals=4).trajectory
    mesh = IntervalMesh(np.linspace(0.0, 1.0, 5))
    # The fifth order: 3^5 times too much needs three pieces and a little more.
    finer = mesh.refined(trajectory, np.array([1e-7, 3.0**5 * 0.6e-6, 1e-7, 1e-7]), 1e-6)
    np.testing.assert_allclose(finer.knots, [0, 0.25, 0.25 + 0.25 / 3, 0.5 - 0.25 / 3, 0.5, 0.75, 1.0])
    coarser = mesh.refined(trajectory, np.array([1e-12, 1e-12, 1e-5, 1e-7]), 1e-6)
    assert coarser.knots[:2].tolist() == [0.0, 0.5]
    monkeypatch.setattr(adaptive_intervals, "MAX_INTERVALS", 15)
    with pytest.raises(MeshLimit, match="more than 15 intervals"):
        mesh.refined(trajectory, np.full(4, 1.0), 1e-9)


def test_a_jump_gets_an_interval_which_becomes_shorter(kinked: Trajectory) -> None:
    mesh, seen = IntervalMesh(np.linspace(0.0, 1.0, 11)), Jump(0.55, 0.5, 0.6, 1e4)

    def refined(mesh: IntervalMesh, excess: float, jump: Jump) -> IntervalMesh:
        on_it = dataclasses.replace(kinked, breakpoints=mesh.knots)
        return mesh.refined(on_it, np.full(mesh.knots.size - 1, excess * 1e-6), 1e-6, [jump])

    cut = refined(mesh, 0.5, seen)
    (held,) = cut.jumps
    np.testing.assert_allclose(cut.knots[held : held + 2], [0.54375, 0.55625])
    assert {0.5, 0.6} < set(np.round(cut.knots, 12).tolist())
    # While other errors are large its place may still move.
    waiting = refined(cut, 2.0, dataclasses.replace(seen, place=0.551))
    (held,) = waiting.jumps
    np.testing.assert_allclose(waiting.knots[held : held + 2], [0.54375, 0.55625])
    shorter = refined(cut, 0.5, Jump(0.551, 0.54, 0.56, 16.0))
    (held,) = shorter.jumps
    assert np.mean(shorter.knots[held : held + 2]) == pytest.approx(0.551)
    assert 0.0125 / 8 < np.diff(shorter.knots)[held] < 0.0125 / 4


def test_jumps_that_are_seen_through_each_other_are_a_singular_arc(kinked: Trajectory) -> None:
    mesh, errors = IntervalMesh(np.array([0.0, 1.0])), np.full(kinked.breakpoints.size - 1, 1e-2)
    jumps = [Jump(place, place - 0.01, place + 0.01, 10.0) for place in (0.2, 0.215, 0.23, 0.245)]
    with pytest.raises(MeshLimit, match=f"chatters between its bounds at t = {0.2 * kinked.tf:.6g}$"):
        mesh.refined(kinked, errors, 1e-6, jumps)


def test_splines_are_refined_no_deeper_than_allowed_and_within_their_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    trajectory = answer(load_case("van_der_pol"), name="swcm", L=5, J=1).trajectory
    errors = np.full(trajectory.breakpoints.size - 1, 1e-3)
    with pytest.raises(MeshLimit, match="max_level = 1 is reached"):
        SplineMesh(GradedKnots.uniform(5, 1), 1).refined(trajectory, errors, 1e-6)
    finer = SplineMesh(GradedKnots.uniform(5, 1), 2).refined(trajectory, errors, 1e-6)
    np.testing.assert_array_equal(finer.knots.levels, 2)
    monkeypatch.setattr(adaptive_splines, "MAX_ACTIVE", 22)
    with pytest.raises(MeshLimit, match="more than 22 active"):
        SplineMesh(GradedKnots.uniform(5, 1), 2).refined(trajectory, errors, 1e-6)
