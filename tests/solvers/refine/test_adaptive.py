"""Adaptive meshes on the benchmark cases, against answers that this code did not produce."""

from __future__ import annotations

import copy
import json
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from solvers.catalogue import load_case
from solvers.formulation.stated import stated_problem
from solvers.meshes import adaptive_mesh_of
from solvers.optimizers.outcome import Limits
from solvers.progress import SilentProgress
from solvers.refine.adaptive import adapt
from solvers.session import Session
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import SplineAdaptivity, SplineWaveletMethod, check_document
from solvers.start.scaling import automatic_scaling
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from tests.solvers.refine.estimates import assert_estimate_is_true

LAYERS = {"name": "swcm", "adaptive": {"tolerance": 1e-7, "max_level": 20}}


def answer(case: str, method: dict[str, Any], **options: Any) -> tuple[Solution, float]:
    """The solution of a case, and its distance from the reference, relative.

    Whatever becomes of it, its error between nodes is estimated from the residual alone.
    """
    document = copy.deepcopy(load_case(case))
    document["method"] = method
    document.setdefault("options", {}).update(options)
    solution = solve(check_document(document))
    reference = document["reference"]["objective"]
    if solution.status is not SolveStatus.TIME_LIMIT:
        assert_estimate_is_true(solution.verification)
    return solution, abs(solution.objective - reference) / abs(reference)


@pytest.fixture(scope="module")
def layers() -> tuple[Solution, float]:
    return answer("hypersensitive", LAYERS)


def test_boundary_layers_over_ten_thousand_seconds_by_six_hundred_wavelets(
    layers: tuple[Solution, float],
) -> None:
    solution, error = layers
    assert solution.success
    assert error <= 1e-8
    adaptive = solution.method["adaptive"]
    assert adaptive["active"] <= 600
    assert adaptive["full"] == 2 ** adaptive["levels"] * 8 + 3
    assert adaptive["compression"] == adaptive["active"] / adaptive["full"] < 1e-3
    assert solution.statistics.variables <= 2 * 600 + 2
    # From the guess, and nine times from an answer: what has no size is scaled well.
    assert solution.statistics.iterations <= 100
    assert solution.verification.tolerances.state_error == 1e-7
    assert solution.verification.tolerances.terminal_error == 1e-7


def test_most_knots_sit_in_the_layers_and_none_is_wasted_between(layers: tuple[Solution, float]) -> None:
    trajectory = layers[0].trajectory
    times = trajectory.time(trajectory.nodes)
    assert np.count_nonzero((times > 50) & (times < 9950)) < 60


@pytest.mark.parametrize(
    "method",
    [
        {"name": "swcm", "J": 4},
        {"name": "gpm", "nodes": 40},
        {"name": "hermite_simpson", "intervals": 1000},
    ],
)
def test_a_mesh_that_does_not_see_the_layers_is_never_called_an_answer(method: dict[str, Any]) -> None:
    solution, error = answer("hypersensitive", method)
    assert error > 0.1
    assert not solution.success
    assert solution.status.value == "unverified"


def test_too_few_levels_end_with_an_honest_word() -> None:
    solution, error = answer("hypersensitive", {"name": "swcm", "adaptive": {}})
    assert error > 1e-3
    assert solution.status.value == "unverified"
    assert "max_level = 10 is reached" in solution.message
    assert solution.warnings[0]["code"] == "tolerance_not_reached"
    assert solution.warnings[0]["pointer"] == "/method/adaptive"
    # No control has two bounds here: advice on switches would be none.
    assert "switching" not in solution.warnings[0]["detail"]


@pytest.mark.parametrize(("method", "limit"), [("gpm", 1e-10), ("hermite_simpson", 1e-6)])
def test_boundary_layers_by_polynomials(method: str, limit: float) -> None:
    solution, error = answer("hypersensitive", {"name": method, "adaptive": {}})
    assert solution.success
    assert error <= limit
    assert solution.trajectory.nodes.size < 1000


SMOOTH = ["brachistochrone", "min_time_orbit_transfer", "van_der_pol", "bryson_denham"]


@pytest.mark.parametrize("case", SMOOTH)
@pytest.mark.parametrize(("method", "limit"), [("swcm", 1e-6), ("gpm", 1e-8), ("hermite_simpson", 1e-8)])
def test_a_smooth_case_ends_verified_at_the_tolerance_of_its_method(
    case: str, method: str, limit: float
) -> None:
    solution, error = answer(case, {"name": method, "adaptive": {}})
    assert solution.success
    assert solution.verification.tolerances.terminal_error == limit
    assert error <= limit
    assert solution.warnings == []


@pytest.mark.parametrize(
    ("case", "mesh", "level"),
    [
        ("brachistochrone", {}, 10),
        ("min_time_orbit_transfer", {}, 10),
        ("hypersensitive", {"L": 16, "J": 3}, 20),
    ],
)
def test_splines_reach_tight_tolerances_too(case: str, mesh: dict[str, int], level: int) -> None:
    """The error at a change of level would wander if the finer patch grew in place of the coarser one."""
    adaptive = {"tolerance": 1e-8, "max_level": level}
    solution, error = answer(case, {"name": "swcm", **mesh, "adaptive": adaptive})
    assert solution.success, solution.message
    assert error <= 1e-8


def test_goddard_by_segments_that_find_the_singular_arc() -> None:
    solution, error = answer("goddard", {"name": "gpm", "adaptive": {}})
    assert solution.success
    assert error <= 1e-8


@pytest.mark.parametrize(
    ("case", "active"), [("rigid_body", 200), ("two_mass_spring", 1_200), ("flexible_spacecraft", 5_000)]
)
def test_a_mesh_that_is_fine_at_the_switches_alone_does_without_their_structure(
    case: str, active: int
) -> None:
    """The flight would be content with less: a slope in the place of a switch costs time, not accuracy.

    What is left of the number of functions is the smooth motion: without an oscillation there is none.
    """
    adaptive = {"tolerance": 1e-8, "max_level": 20}
    solution, error = answer(case, {"name": "swcm", "adaptive": adaptive})
    assert solution.success, solution.message
    assert solution.warnings == []
    assert error <= 1e-8
    assert solution.method["adaptive"]["active"] <= active
    assert len(solution.convergence) <= 4
    reference = load_case(case)["reference"]["switching"]
    for name, times in reference.items():
        np.testing.assert_allclose(solution.switching[name]["times"], times, rtol=0, atol=5e-4)


@pytest.mark.parametrize(("case", "nodes"), [("two_mass_spring", 100), ("flexible_spacecraft", 400)])
def test_segments_of_one_node_hold_the_switches(case: str, nodes: int) -> None:
    """Polynomials of higher degree would pass the bounds beside a switch, on however short segments."""
    solution, error = answer(case, {"name": "gpm", "adaptive": {}})
    assert solution.success, solution.message
    assert error <= 1e-8
    assert solution.method["adaptive"]["nodes"] <= nodes
    assert solution.verification.max_bound_violation is not None
    assert solution.verification.max_bound_violation <= 1e-8


@pytest.mark.parametrize(
    ("case", "tolerance", "intervals"),
    [("rigid_body", 1e-8, 80), ("two_mass_spring", 1e-8, 300), ("flexible_spacecraft", 1e-6, 600)],
)
def test_parabolas_within_their_bounds_hold_the_switches(case: str, tolerance: float, intervals: int) -> None:
    method = {"name": "hermite_simpson", "adaptive": {"tolerance": tolerance}}
    solution, error = answer(case, method)
    assert solution.success, solution.message
    assert solution.warnings == []
    assert error <= tolerance
    assert solution.method["adaptive"]["intervals"] <= intervals
    assert solution.verification.max_bound_violation is not None
    assert solution.verification.max_bound_violation <= 1e-12


def test_parabolas_follow_a_car_around_an_obstacle_between_its_sharpest_turns() -> None:
    """Arcs of radius 1 about (0, 1), the obstacle and (10, 3/2), and the inner tangents of these circles."""
    document: dict[str, Any] = {
        "problem": {
            "model": {
                "kind": "first_order",
                "states": ["x", "y", "psi"],
                "controls": ["w"],
                "dynamics": {"x": "cos(psi)", "y": "sin(psi)", "psi": "w"},
            },
            "final_time": [1, 50],
            "initial_state": {"*": 0},
            "final_state": {"x": 10, "y": 0.5, "psi": 0},
            "bounds": {"w": [-1, 1]},
            "path_constraints": [{"expression": "(x-5)^2 + (y-0.2)^2", "bounds": [1, None]}],
            "objective": {"terminal": "tf"},
        },
        "method": {"name": "hermite_simpson", "adaptive": {"tolerance": 1e-6}},
    }
    solution = solve(check_document(document))
    ways = [5.0 - 0.8j, 5.0 + 1.3j]
    tangents = [np.sqrt(abs(way) ** 2 - 4.0) for way in ways]
    up = np.angle(ways[0]) + np.arcsin(2.0 / abs(ways[0]))
    down = np.arcsin(2.0 / abs(ways[1])) - np.angle(ways[1])
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(2.0 * (up + down) + sum(tangents), rel=1e-6)


def test_a_singular_arc_on_which_parabolas_chatter_ends_with_advice() -> None:
    solution, error = answer("goddard", {"name": "hermite_simpson", "adaptive": {}})
    assert error < 1e-5
    assert solution.status.value == "unverified"
    assert len(solution.convergence) <= 5
    (warning,) = solution.warnings
    assert "a control chatters between its bounds at t = " in warning["detail"]
    assert "refine: switching" in warning["detail"]


def test_what_a_slope_in_the_place_of_a_switch_costs_is_estimated_too() -> None:
    plain, error = answer("two_mass_spring", {"name": "swcm"})
    assert plain.verification.max_state_error is not None
    assert plain.verification.max_state_error < 2e-5
    assert error > 5e-5


def test_switches_at_the_finest_level_end_with_advice() -> None:
    solution, _ = answer("rigid_body", {"name": "swcm", "adaptive": {"tolerance": 1e-6, "max_level": 5}})
    assert [check.name for check in solution.verification.checks if not check.passed] == ["mesh_error"]
    (warning,) = solution.warnings
    assert "max_level = 5 is reached" in warning["detail"]
    assert "refine: switching" in warning["detail"]
    assert warning["detail"] in solution.message


@pytest.mark.parametrize(
    ("case", "method"),
    [
        ("rigid_body", {"name": "swcm", "L": 7, "J": 2, "adaptive": {"tolerance": 1e-4}}),
        ("brachistochrone", {"name": "swcm", "J": 2, "adaptive": {"tolerance": 1e-5}}),
        ("hypersensitive", LAYERS),
        ("brachistochrone", {"name": "hermite_simpson", "intervals": 5, "adaptive": {}}),
        ("min_time_orbit_transfer", {"name": "gpm", "adaptive": {}}),
    ],
)
def test_a_stored_result_gives_the_trajectory_back(case: str, method: dict[str, Any]) -> None:
    solution, _ = answer(case, method)
    result = json.loads(json.dumps(solution.result(), allow_nan=False))
    again, first = Trajectory.from_result(result), solution.trajectory
    tau = np.linspace(0, 1, 997)
    np.testing.assert_allclose(again.states_at(tau), first.states_at(tau), rtol=0, atol=1e-12)
    np.testing.assert_allclose(again.controls_at(tau), first.controls_at(tau), rtol=0, atol=1e-12)
    rates = first.rates_at(tau)
    np.testing.assert_allclose(again.rates_at(tau), rates, rtol=0, atol=1e-9 * np.abs(rates).max())
    np.testing.assert_allclose(again.breakpoints, first.breakpoints, rtol=0, atol=1e-15)
    np.testing.assert_allclose(again.nodes, first.nodes, rtol=0, atol=1e-15)


def test_the_result_holds_the_active_wavelets_by_level(layers: tuple[Solution, float]) -> None:
    result = layers[0].result()
    basis, adaptive = result["coefficients"]["basis"], result["method"]["adaptive"]
    assert basis["name"] == "cubic_spline_wavelet"
    assert basis["J"] == adaptive["levels"] == len(basis["active"])
    assert basis["order"] == ["V0", *(f"W{level}" for level in range(basis["J"]))]
    assert 8 + 3 + sum(map(len, basis["active"])) == adaptive["active"]
    assert len(result["coefficients"]["states"]["x"]) == adaptive["active"]
    for level, indices in enumerate(basis["active"]):
        assert indices == sorted(set(indices))
        assert 0 <= indices[0] <= indices[-1] < 2**level * 8


def test_every_mesh_is_told_with_its_error(layers: tuple[Solution, float]) -> None:
    solution = layers[0]
    errors = [row["error_estimate"] for row in solution.convergence]
    nodes = [row["nodes"] for row in solution.convergence]
    assert len(errors) <= 12
    assert errors[0] > 0.1
    assert errors[-1] <= 1e-7
    assert min(np.diff(nodes)) < 0, "knots that are no longer needed are given up"
    assert all(row["objective"] is not None for row in solution.convergence)


def test_progress_of_an_adaptive_solve_never_runs_backwards() -> None:
    class Recorder:
        def __init__(self) -> None:
            self.fractions: list[float] = []

        def report(self, report: Any) -> None:
            self.fractions.append(report.fraction)

        def cancelled(self) -> bool:
            return False

    recorder = Recorder()
    document = {**load_case("two_mass_spring"), "method": {"name": "swcm", "adaptive": {}}}
    solve(check_document(document), recorder)
    assert recorder.fractions == sorted(recorder.fractions)
    assert recorder.fractions[-1] == 1.0


def test_meshes_that_may_take_no_time_leave_the_best_answer_with_the_reason(session: Session) -> None:
    (part,), limits = session.parts, session.limits
    method = SplineWaveletMethod(name="swcm", J=2, adaptive=SplineAdaptivity(tolerance=1e-8, max_level=10))
    mesh = adaptive_mesh_of(method, part.problem)
    start = mesh.transcription(part.problem, part.scaling, part.problem.guess)
    first = session.solve_parts([start], "solve")
    adapted = adapt(session, [mesh], 1e-8, first, seconds=0.0)
    assert adapted.solved is first
    assert adapted.reason is not None
    assert "0 s were not enough" in adapted.reason
    assert session.limits is limits


def test_an_answer_that_is_stopped_is_the_best_mesh_so_far(session: Session) -> None:
    (part,) = session.parts
    method = SplineWaveletMethod(name="swcm", J=2, adaptive=SplineAdaptivity(tolerance=1e-8, max_level=10))
    mesh = adaptive_mesh_of(method, part.problem)
    first = session.solve_parts([mesh.transcription(part.problem, part.scaling, part.problem.guess)], "solve")
    session.limits = replace(session.limits, deadline=time.monotonic())
    adapted = adapt(session, [mesh], 1e-8, first)
    assert adapted.solved.trajectory is first.trajectory
    assert adapted.solved.outcome.status is SolveStatus.TIME_LIMIT


@pytest.fixture
def session() -> Session:
    problem = stated_problem(check_document(load_case("rigid_body")).problem)
    progress = SilentProgress()
    return Session(
        problem=problem,
        scaling=automatic_scaling(problem),
        tolerance=1e-8,
        max_iterations=500,
        limits=Limits(time.monotonic() + 60.0, progress.cancelled),
        progress=progress,
    )


def test_an_answer_that_flies_well_and_gives_too_much_away_is_not_called_one() -> None:
    """Least variation of a rate-limited force: a slope a / 10 in the middle of u = a, then -a, costs 2 a."""
    amplitude = brentq(lambda a: a * 2.5**2 / 4 - a**3 / 300 - 1, 0, 1)
    model = {
        "kind": "first_order",
        "states": ["x", "v"],
        "controls": ["u"],
        "dynamics": {"x": "v", "v": "u"},
    }
    problem = {
        "model": model,
        "final_time": 2.5,
        "initial_state": {"*": 0},
        "final_state": {"x": 1, "v": 0},
        "bounds": {"u": [-1, 1]},
        "control_rates": {"u": [-10, 10]},
        "objective": {"running": "abs(u_dot)"},
    }
    solution = solve(check_document({"problem": problem, "method": {"name": "swcm", "adaptive": {}}}))
    (check,) = [check for check in solution.verification.checks if check.name == "mesh_error"]
    assert check.limit == pytest.approx(1e-5)
    off = abs(solution.objective / (2 * amplitude) - 1)
    assert check.passed == solution.success == (off <= 1e-5)
