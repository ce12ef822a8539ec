"""What a solve does besides converging: stopping, failing with a reason, telling how it goes."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from solvers.catalogue import load_case
from solvers.progress import ProgressReport
from solvers.sizes import problem_size
from solvers.solve import solve
from solvers.spec import check_document
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory

METHODS = [
    {"name": "swcm", "L": 5, "J": 2},
    {"name": "gpm", "nodes": 8, "segments": 3},
    {"name": "hermite_simpson", "intervals": 10},
]
GENETIC = {"name": "ga", "scaling_functions": 6, "population": 8, "generations": 3}


class Recorder:
    """Keeps the reports; asks to stop after a number of questions, which it counts."""

    def __init__(self, patience: int | None = None) -> None:
        self.reports: list[ProgressReport] = []
        self.asked = 0
        self._patience = patience

    def report(self, report: ProgressReport) -> None:
        self.reports.append(report)

    def cancelled(self) -> bool:
        self.asked += 1
        return self._patience is not None and self.asked > self._patience


def test_progress_tells_stage_iteration_objective_and_infeasibility(
    flexible_spacecraft: dict[str, Any],
) -> None:
    recorder = Recorder()
    answer = solve(check_document({**flexible_spacecraft, "method": {"name": "swcm", "J": 8}}), recorder)
    stages = [report.stage for report in recorder.reports]
    assert stages[0] == "solve level 1 of 3"
    assert stages[-1] == "verify"
    assert recorder.reports[-1].objective == answer.objective
    first = recorder.reports[0]
    assert first.objective is not None
    assert first.infeasibility is not None
    fractions = [report.fraction for report in recorder.reports]
    assert fractions == sorted(fractions)


def test_a_cancelled_solve_keeps_its_last_iterate_and_its_verification(
    flexible_spacecraft: dict[str, Any],
) -> None:
    solution = solve(check_document(flexible_spacecraft), Recorder(patience=2))
    assert solution.status is SolveStatus.CANCELLED
    assert not solution.success
    assert solution.statistics.iterations <= 12
    assert solution.verification.max_state_error is not None


def test_a_time_limit_ends_between_iterations(flexible_spacecraft: dict[str, Any]) -> None:
    document = {**flexible_spacecraft, "method": {"name": "swcm", "J": 9}, "options": {"max_seconds": 0.2}}
    solution = solve(check_document(document))
    assert solution.status is SolveStatus.TIME_LIMIT
    assert "max_seconds" in solution.message


def test_an_iteration_limit(flexible_spacecraft: dict[str, Any]) -> None:
    solution = solve(check_document({**flexible_spacecraft, "options": {"max_iterations": 3}}))
    assert solution.status is SolveStatus.ITERATION_LIMIT


@pytest.mark.parametrize("method", METHODS)
def test_a_cost_that_falls_for_ever_diverges(regulator: dict[str, Any], method: dict[str, Any]) -> None:
    regulator["problem"] |= {"objective": {"terminal": "-x_f"}, "bounds": {}, "final_state": {}}
    solution = solve(check_document({**regulator, "method": method}))
    assert solution.status is SolveStatus.DIVERGED
    assert solution.statistics.iterations < 200


def test_what_cannot_be_reached_is_infeasible(flexible_spacecraft: dict[str, Any]) -> None:
    flexible_spacecraft["problem"]["final_time"] = 20
    solution = solve(check_document(flexible_spacecraft))
    assert solution.status is SolveStatus.INFEASIBLE
    assert "No feasible point was found" in solution.message


@pytest.mark.parametrize("method", [*METHODS, GENETIC])
def test_an_expression_without_a_value_is_named(regulator: dict[str, Any], method: dict[str, Any]) -> None:
    regulator["problem"]["model"]["dynamics"]["x"] = "u + sqrt(x - 2)"
    solution = solve(check_document({**regulator, "method": method}))
    assert solution.status is SolveStatus.EVALUATION_ERROR
    assert "/problem/model/dynamics/x" in solution.message
    assert "sqrt(x - 2)" in solution.message
    assert "x = 1" in solution.message


def test_an_exception_of_the_watcher_ends_the_solve_and_is_not_swallowed(
    flexible_spacecraft: dict[str, Any],
) -> None:
    class Broken(Recorder):
        def cancelled(self) -> bool:
            raise ConnectionError("gone")

    with pytest.raises(ConnectionError, match="gone"):
        solve(check_document(flexible_spacecraft), Broken())


@pytest.mark.parametrize("method", METHODS)
def test_a_result_is_json_and_gives_its_trajectory_back_exactly(
    flexible_spacecraft: dict[str, Any], method: dict[str, Any]
) -> None:
    solution = solve(check_document({**flexible_spacecraft, "method": method}))
    result = json.loads(json.dumps(solution.result("a-job"), allow_nan=False))
    assert result["job_id"] == "a-job"
    again = Trajectory.from_result(result)
    tau = np.linspace(0, 1, 101)
    np.testing.assert_allclose(again.states_at(tau), solution.trajectory.states_at(tau), rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        again.controls_at(tau), solution.trajectory.controls_at(tau), rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(again.rates_at(tau), solution.trajectory.rates_at(tau), rtol=0, atol=1e-11)


@pytest.mark.parametrize("method", METHODS)
def test_the_size_told_in_advance_is_the_size_of_the_program(
    flexible_spacecraft: dict[str, Any], method: dict[str, Any]
) -> None:
    problem = flexible_spacecraft["problem"]
    problem["initial_time"] = [0, 2]
    problem["bounds"] |= {"theta": [-1, 1], "alpha_dot": [-0.5, None], "theta_dot": [-1, 1]}
    problem["path_constraints"] = [{"expression": "alpha + T", "bounds": [-9, 9]}]
    problem["path_constraints"].append({"expression": "theta", "bounds": [-9, 9], "during": [0.25, 0.7]})
    problem["boundary_constraints"] = [{"expression": "theta_f - theta_0", "bounds": [0, 2]}]
    problem["integrals"] = [{"name": "work", "expression": "T*theta_dot"}]
    problem["design"] = {"k": {"bounds": [90, 110]}}
    problem["initial_control"] = {"T": [-1, 1]}
    spec = check_document({**flexible_spacecraft, "method": method})
    size, solution = problem_size(spec), solve(spec)
    assert (size.variables, size.constraints) == (
        solution.statistics.variables,
        solution.statistics.constraints,
    )


@pytest.mark.parametrize("method", METHODS)
def test_path_boundary_and_state_constraints_hold_and_are_reported(
    oscillator: dict[str, Any], method: dict[str, Any]
) -> None:
    problem = oscillator["problem"]
    problem["bounds"] = {"x_dot": [None, 0.7]}
    problem["path_constraints"] = [{"name": "load", "expression": "u + x", "bounds": [None, 1.5]}]
    problem["final_state"] = {"x_dot": 0}
    problem["boundary_constraints"] = [{"expression": "x_f - x_0", "bounds": 1}]
    solution = solve(check_document({**oscillator, "method": method}))
    assert solution.success, solution.message
    end = solution.trajectory.states_at(np.array([1.0]))[:, 0]
    np.testing.assert_allclose(end, [1.0, 0.0], atol=1e-7)
    by_pointer = {item["pointer"]: item for item in solution.constraints}
    speed = by_pointer["/problem/bounds/x_dot"]
    assert speed["max"] == pytest.approx(0.7, abs=7e-3)
    assert speed["active"]
    assert by_pointer["/problem/path_constraints/0"]["max"] <= 1.5 + 1e-2


@pytest.mark.parametrize("method", METHODS)
def test_a_free_initial_time_and_a_bolza_objective(
    oscillator: dict[str, Any], method: dict[str, Any]
) -> None:
    """Shifting time changes nothing: with t0 free and t0 = 1 wanted, the answer is the one from 0 to 2."""
    plain = solve(check_document({**oscillator, "method": method}))
    problem = oscillator["problem"]
    problem |= {"initial_time": [0, 5], "final_time": [1, 9], "guess": {"final_time": 4}}
    problem["boundary_constraints"] = [{"expression": "tf - t0", "bounds": 2}]
    problem["objective"] = {"running": "u^2/2", "terminal": "(t0 - 1)^2 + 3"}
    shifted = solve(check_document({**oscillator, "method": method}))
    assert shifted.trajectory.t0 == pytest.approx(1.0, abs=1e-6)
    assert shifted.objective == pytest.approx(plain.objective + 3.0, abs=1e-7)
    assert shifted.verification.objective == pytest.approx(shifted.objective, rel=1e-2)


def test_samples_hold_every_switch_twice_besides_the_equidistant_ones(rigid_body: dict[str, Any]) -> None:
    result = solve(check_document({**rigid_body, "output": {"samples": 11}})).result()
    times = np.array(result["trajectory"]["t"])
    (switch,) = result["switching"]["u"]["times"]
    assert switch == pytest.approx(1.0, abs=1e-2)
    assert np.count_nonzero(times == switch) == 2
    equidistant = np.linspace(0, result["final_time"], 11)
    np.testing.assert_allclose(times[times != switch], equidistant[equidistant != switch])


def test_what_is_not_computed_is_null(rigid_body: dict[str, Any]) -> None:
    result = solve(check_document({**rigid_body, "options": {"max_iterations": 3}})).result()
    assert result["sensitivity"] is None
    assert all(math.isfinite(value) for value in result["statistics"]["seconds"].values())


def test_a_fine_mesh_stays_near_the_coarse_one_that_it_starts_from() -> None:
    """A barrier that is the same for 8,000 bounds as for 200 drives it away, inexact steps let it wander."""
    case = load_case("two_mass_spring")
    solution = solve(check_document({**case, "method": {"name": "swcm", "J": 9}}))
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(case["reference"]["objective"], rel=3e-7)
    last = solution.convergence[-1]
    assert last["nodes"] == 4097
    assert last["iterates"][-1][0] - last["iterates"][0][0] <= 20


def test_a_solve_is_asked_to_stop_before_a_fine_mesh_is_built(flexible_spacecraft: dict[str, Any]) -> None:
    """Between two levels: the answer of the coarse one comes back as it is."""
    coarse = Recorder()
    solve(check_document({**flexible_spacecraft, "method": {"name": "swcm", "J": 3}}), coarse)
    document = {**flexible_spacecraft, "method": {"name": "swcm", "J": 6}}
    solution = solve(check_document(document), Recorder(patience=coarse.asked))
    assert solution.status is SolveStatus.CANCELLED
    assert len(solution.convergence) == 1
    assert solution.trajectory.nodes.size == 8 * 2**3 + 1


def test_the_iterates_of_each_mesh_are_kept(flexible_spacecraft: dict[str, Any]) -> None:
    """From the final time that was guessed to the one that was found, and to no infeasibility."""
    solution = solve(check_document({**flexible_spacecraft, "method": {"name": "swcm", "J": 3}}))
    (mesh,) = solution.convergence
    iterations, objectives, infeasibilities = zip(*mesh["iterates"], strict=True)
    assert iterations[0] == 0
    assert list(iterations) == sorted(set(iterations))
    assert iterations[-1] == solution.statistics.iterations
    assert objectives[0] == pytest.approx(flexible_spacecraft["problem"]["guess"]["final_time"])
    assert objectives[-1] == mesh["objective"] == solution.objective
    assert infeasibilities[0] > 1e-3 > 1e-8 > infeasibilities[-1]
