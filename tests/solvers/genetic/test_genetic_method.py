"""Whole solves by the genetic algorithm: optima of the basis, both variants, stopping, results."""

from __future__ import annotations

import json
import os
import runpy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solvers.bases.daubechies import DaubechiesBasis
from solvers.catalogue import load_case
from solvers.progress import ProgressReport
from solvers.sizes import problem_size
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from tests.solvers.transcription.test_daubechies_controls import solved as solved_in

OPTIMA = runpy.run_path(str(Path(__file__).parents[3] / "benchmarks" / "solar_array_optima.py"))
EXACT, PENALISED = OPTIMA["EXACT"], OPTIMA["PENALISED"]
# Those that are solved here; all of them, with all seeds: benchmarks/genetic.py.
SOLVED = [("1", 0), ("2", 0), ("2neg", 0), ("2neg", 1)]


class Watcher:
    """Keeps the reports; asks to stop after a number of questions."""

    def __init__(self, patience: int = 10**9) -> None:
        self.reports: list[ProgressReport] = []
        self.patience = patience

    def report(self, report: ProgressReport) -> None:
        self.reports.append(report)

    def cancelled(self) -> bool:
        self.patience -= 1
        return self.patience < 0


def children() -> list[int]:
    """The processes that this one has started and not yet ended."""
    listed = Path(f"/proc/self/task/{os.getpid()}/children").read_text()
    return [int(pid) for pid in listed.split()]


def document(case: str, options: dict[str, Any] | None = None, **method: Any) -> dict[str, Any]:
    return load_case(f"solar_array_{case}") | {"method": {"name": "ga", **method}, "options": options or {}}


def solved(case: str, options: dict[str, Any] | None = None, **method: Any) -> Solution:
    return solve(check_document(document(case, options, **method)))


@cache
def result_of(case: str, polish: str | bool, levels: int = 0) -> dict[str, Any]:
    result: dict[str, Any] = solved(case, polish=polish, wavelet_levels=levels).result("a-job")
    return result


@pytest.mark.parametrize(("case", "levels"), SOLVED)
def test_exact_polish_reaches_the_optimum_of_the_basis(case: str, levels: int) -> None:
    result = result_of(case, "exact", levels)
    assert result["success"], result["message"]
    assert result["objective"] == result["energy"] == pytest.approx(EXACT[case, levels], rel=1e-7)
    assert result["residual"] <= 1e-9
    states = result["verification"]["states"].values()
    assert max(state["terminal_error"] for state in states) <= 1e-6


@pytest.mark.parametrize("case", ["1", "2", "2neg"])
@pytest.mark.parametrize("polish", ["penalty", False])
def test_penalised_optimum(case: str, polish: str | bool) -> None:
    result = result_of(case, polish)
    assert result["success"], result["message"]
    reached = result["energy"] + result["penalty"] * result["residual"] ** 2
    assert reached == pytest.approx(PENALISED[case, 0], abs=6e-7)
    assert result["objective"] == result["energy"]
    assert "penalised" in result["message"]


def test_the_energy_is_the_sum_of_the_squares_of_the_coefficients() -> None:
    result = solved("2neg", polish=False, wavelet_levels=1, generations=30, refine_generations=30).result()
    coefficients = np.array(list(result["coefficients"]["controls"].values()))
    assert coefficients.shape == (3, 10)
    assert result["energy"] == pytest.approx(float(np.sum(coefficients**2)), rel=1e-12)


def test_a_result_has_what_the_method_has_to_say() -> None:
    result = result_of("2", False)
    basis = result["coefficients"]["basis"]
    for key in ("wavelet", "boundary", "scaling_functions", "wavelet_levels"):
        assert basis[key] == result["method"][key]
    assert result["method"]["population"] == 48
    assert result["provenance"]["seed"] == 0
    assert result["penalty"] == 100.0
    history = result["fitness_history"]
    assert history == sorted(history, reverse=True)
    assert history[-1] == pytest.approx(PENALISED["2", 0], rel=1e-5)
    assert len(result["starts"]) == 2  # found twice
    assert [start["kept"] for start in result["starts"]].count(True) == 1
    assert result["statistics"]["nlp_solver"] is None
    assert set(result["nodes"]["costates"]["phi1"]) == {None}
    names = [check["name"] for check in result["verification"]["checks"]]
    assert names[0] == "residual"


@pytest.mark.parametrize("polish", ["exact", False])
def test_a_result_is_json_and_gives_its_trajectory_back_exactly(polish: str | bool) -> None:
    result = result_of("2", polish)
    again = Trajectory.from_result(json.loads(json.dumps(result, allow_nan=False)))
    sampled = again.sample(np.array(result["trajectory"]["t"]))
    for kind in ("states", "controls"):
        for name, values in result["trajectory"][kind].items():
            np.testing.assert_allclose(sampled[kind][name], values, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("case", "low", "high"), [("1", 4.44, 4.95), ("2neg", 8.62, 10.2)])
def test_classic_is_as_good_as_the_paper_and_no_better(case: str, low: float, high: float) -> None:
    """The median of three seeds; single ones end in a worse basin."""
    histories = [
        solved(case, variant="classic", polish=False, seed=seed).extras["fitness_history"]
        for seed in range(3)
    ]
    assert [len(history) for history in histories] == [2001] * 3
    assert low < np.median([history[-1] for history in histories]) < high


def test_classic_superimposes_wavelets_that_start_at_zero() -> None:
    method = {"variant": "classic", "polish": False, "generations": 60, "wavelet_levels": 1}
    without = solved("2", **method, refine_generations=0)
    coefficients = np.array([curve.coefficients for curve in without.trajectory.controls.values()])
    assert np.all(coefficients[:, 5:] == 0.0)
    assert np.all(coefficients[:, :5] != 0.0)
    refined = solved("2", **method, refine_generations=60)
    histories = [solution.extras["fitness_history"] for solution in (without, refined)]
    assert histories[0][:61] == histories[1][:61]
    assert histories[1][-1] < histories[0][-1]


@pytest.mark.parametrize("variant", ["classic", "modern"])
def test_the_same_seed_gives_the_same_answer_and_another_one_another(variant: str) -> None:
    method = {"variant": variant, "polish": False, "generations": 40}
    first, second, other = (
        solved("2", **method, seed=seed).result()["coefficients"]["controls"] for seed in (5, 5, 6)
    )
    assert first == second
    assert first != other


def test_the_best_of_several_starts_is_kept() -> None:
    method = {"variant": "classic", "polish": False, "generations": 30, "population": 20}
    alone, several = (solved("2", {"starts": count}, **method).result() for count in (1, 3))
    assert [len(found["fitness_history"]) for found in (alone, several)] == [31, 93]
    assert several["starts"][0]["objective"] == alone["objective"]
    reached = [start["objective"] for start in several["starts"]]
    assert len(set(reached)) == 3
    assert several["fitness_history"][-1] <= alone["fitness_history"][-1]


@pytest.mark.parametrize(
    "method",
    [
        {"variant": "classic", "wavelet_levels": 1, "refine_generations": 20},
        {"variant": "modern", "generations": 260},  # enough for the first run, not for the second one
    ],
    ids=lambda method: method["variant"],
)
def test_processes_change_nothing_but_the_time(monkeypatch: pytest.MonkeyPatch, method: Any) -> None:
    monkeypatch.setattr("solvers.genetic.solve.cores", lambda: 2)
    method = {"polish": False, "generations": 60} | method
    alone, together = (solved("2neg", {"starts": 2}, processes=count, **method).result() for count in (1, 2))
    assert len(alone["starts"]) == 2
    for key in ("coefficients", "fitness_history", "starts", "trajectory", "residual"):
        assert alone[key] == together[key]


def test_a_search_in_several_processes_is_cancelled_and_leaves_none_behind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("solvers.genetic.solve.cores", lambda: 2)
    pids: list[int] = []

    class Impatient(Watcher):
        """Asks to stop as soon as the processes have told something."""

        def cancelled(self) -> bool:
            return bool(self.reports)

        def report(self, report: ProgressReport) -> None:
            super().report(report)
            pids.extend(children() if not pids else [])

    watcher, before = Impatient(), set(children())
    method = {"variant": "classic", "generations": 100_000, "processes": 2}
    solution = solve(check_document(document("2", {"starts": 2}, **method)), watcher)
    assert solution.status is SolveStatus.CANCELLED
    assert len(set(pids) - before) == 2
    assert set(children()) <= before
    result = solution.result()
    assert {start["status"] for start in result["starts"]} == {"cancelled"}
    assert result["fitness_history"]
    assert result["verification"]["max_state_error"] is not None
    assert watcher.reports[0].diversity


def test_collocation_takes_over_and_knows_no_basis() -> None:
    result = solved("2neg", refine="collocation").result()
    assert result["success"]
    assert result["objective"] == pytest.approx(8.124095534911, rel=1e-9)
    assert result["energy"] == result["objective"]
    assert result["residual"] <= 1e-9
    assert result["fitness_history"]
    assert result["method"]["collocation"]["name"] == "auto"
    assert result["coefficients"]["basis"]["name"] != "daubechies"
    assert result["verification"]["hamiltonian_drift"] <= 1e-6


def test_progress_tells_generation_objective_residual_and_diversity() -> None:
    watcher = Watcher()
    solve(check_document(document("2", wavelet_levels=1, generations=60, refine_generations=60)), watcher)
    searching = [report for report in watcher.reports if report.stage.startswith("search")]
    assert searching[0].stage == "search level 1 of 2"
    assert {"search level 2 of 2", "polish", "verify"} <= {report.stage for report in watcher.reports}
    assert all(report.objective and report.infeasibility for report in searching)
    assert all(report.diversity is not None and report.diversity > 0 for report in searching)
    fractions = [report.fraction for report in watcher.reports]
    assert fractions == sorted(fractions)


@pytest.mark.parametrize("variant", ["classic", "modern"])
def test_a_cancelled_search_keeps_its_best_with_its_verification(variant: str) -> None:
    watcher = Watcher(patience=25)
    solution = solve(check_document(document("2", variant=variant)), watcher)
    assert solution.status is SolveStatus.CANCELLED
    assert not solution.success
    result = solution.result()
    assert 20 <= len(result["fitness_history"]) <= 25
    assert result["verification"]["max_state_error"] <= 1e-4
    assert result["starts"][-1]["status"] == "cancelled"


def test_a_search_without_polish_runs_into_its_time_limit() -> None:
    solution = solved("2", {"max_seconds": 0.3}, variant="classic", polish=False, generations=2_000_000)
    assert solution.status is SolveStatus.TIME_LIMIT
    assert np.isfinite(solution.objective)


def test_a_search_leaves_time_for_its_polish() -> None:
    solution = solved("2", {"max_seconds": 4}, variant="classic", generations=2_000_000)
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(EXACT["2", 0], rel=1e-7)
    assert solution.warnings[0]["code"] == "search_cut_short"


def test_a_start_is_the_answer_of_an_earlier_job() -> None:
    earlier = solved("1", polish=False).trajectory
    spec = check_document(document("1", generations=1, population=4) | {"warm_start": "earlier"})
    solution = solve(spec, earlier=earlier)
    assert solution.success
    assert solution.objective == pytest.approx(EXACT["1", 0], rel=1e-7)


def test_a_search_that_never_had_a_value_names_the_expression(regulator: dict[str, Any]) -> None:
    regulator["problem"]["model"]["dynamics"]["x"] = "u + sqrt(x - 2)"
    regulator["method"] = {"name": "ga", "population": 8, "generations": 3, "variant": "classic"}
    solution = solve(check_document(regulator))
    assert solution.status is SolveStatus.EVALUATION_ERROR
    assert "/problem/model/dynamics/x" in solution.message


def test_the_size_told_in_advance_is_the_size_of_the_polish(oscillator: dict[str, Any]) -> None:
    problem = oscillator["problem"]
    problem["bounds"] = {"u": [-9, 9], "x": [-2, 2]}
    problem["path_constraints"] = [{"expression": "x + u", "bounds": [-9, 9], "during": [0.25, 0.5]}]
    problem["initial_control"] = {"u": [-1, 1]}
    oscillator["method"] = {
        "name": "ga",
        "population": 20,
        "generations": 30,
        "boundary": "interval",
        "wavelet_levels": 1,
    }
    spec = check_document(oscillator)
    size, solution = problem_size(spec), solve(spec)
    assert solution.success, solution.message
    assert (size.variables, size.constraints) == (
        solution.statistics.variables,
        solution.statistics.constraints,
    )
    assert size.seconds > 0


def test_functions_of_higher_order_come_near_the_optimum_of_any_control_from_above() -> None:
    basis = {"wavelet": "db3", "boundary": "interval", "scaling_functions": 9, "wavelet_levels": 1}
    result = solved("1", **basis, generations=60, refine_generations=10).result()
    assert result["success"], result["message"]
    assert 0.0 <= result["objective"] / 4.4433674699728 - 1.0 <= 1e-8


def test_polished_is_the_optimum_of_the_basis_where_steps_have_to_be_taken(
    flexible_spacecraft: dict[str, Any],
) -> None:
    """Minimum time of the flexible spacecraft: the same by collocation in the basis, from the guess."""
    flexible_spacecraft["method"] = {
        "name": "ga",
        "generations": 20,
        "boundary": "interval",
        "scaling_functions": 12,
    }
    solution = solve(check_document(flexible_spacecraft))
    assert solution.success, solution.message
    basis = DaubechiesBasis(2, 12, 0, periodic=False)
    expected = solved_in(flexible_spacecraft, basis, basis.answer_level)
    assert solution.objective == pytest.approx(expected.objective, rel=1e-9)


def test_minimum_time_with_a_bounded_control(rigid_body: dict[str, Any]) -> None:
    """The final time is a gene, the bound a penalty; polished, both are exact."""
    rigid_body["method"] = {"name": "ga", "boundary": "interval", "scaling_functions": 10, "generations": 60}
    solution = solve(check_document(rigid_body))
    assert solution.success, solution.message
    assert 2.0 < solution.objective < 2.2
    assert solution.verification.max_bound_violation <= 1e-9
    assert solution.switching["u"]["arcs"][0] == "upper"
