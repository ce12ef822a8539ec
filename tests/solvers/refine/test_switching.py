"""The switching refinement from the document to the result, against answers that are known."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from solvers.catalogue import load_case
from solvers.progress import ProgressReport
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document
from solvers.start.prediction import predicted
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.verification.flight import ControlledModel
from tests.solvers.refine.estimates import assert_estimate_is_true

METHODS = ["swcm", "gpm", "hermite_simpson"]

# Error of the objective, and of every switch: a singular control decides its switches more weakly.
FIGURES = {
    "rigid_body": (1e-10, 1e-10),
    "flexible_spacecraft": (1e-8, 1e-7),
    "two_mass_spring": (1e-9, 1e-7),
    "goddard": (1e-9, 1e-6),
    "bryson_denham": (1e-10, None),
    "brachistochrone": (1e-10, None),
    "van_der_pol": (1e-10, None),
    "min_time_orbit_transfer": (1e-10, None),
}


def refined(document: dict[str, Any], method: str = "swcm", **options: Any) -> Solution:
    document = {**document, "method": {"name": method, "refine": "switching"}, "options": options}
    return solve(check_document(document))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", FIGURES)
def test_a_refined_answer_is_exact_and_flies(case: str, method: str) -> None:
    document = load_case(case)
    reference = document["reference"]
    solution = refined(document, method)
    result = solution.result()
    error, switch_error = FIGURES[case]
    assert solution.success, solution.message
    assert result["objective"] == pytest.approx(reference["objective"], abs=error)
    assert result["method"]["refine"] == "switching"
    assert result["warnings"] == []
    assert solution.verification.terminal_error is not None
    assert solution.verification.terminal_error <= 1e-8
    assert solution.verification.max_bound_violation <= 1e-9
    assert_estimate_is_true(solution.verification)
    for name, times in (reference["switching"] if switch_error else {}).items():
        assert result["switching"][name]["times"] == pytest.approx(times, abs=switch_error)


def test_the_hypersensitive_problem_is_refined_from_a_mesh_that_shows_nothing_of_it() -> None:
    """The first objective is far from the true one; `auto` is tested from splines, which are as far off."""
    document = load_case("hypersensitive")
    solution = refined(document, "gpm")
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(document["reference"]["objective"], rel=1e-10)
    assert_estimate_is_true(solution.verification)


def test_the_result_says_what_was_done() -> None:
    result = refined(load_case("goddard")).result()
    arcs = result["switching"]["T"]
    assert arcs["arcs"] == ["upper", "interior", "lower"]
    assert arcs["levels"] == [3.5, None, 0.0]
    assert result["method"]["arcs"] == 3
    assert [len(counts) for counts in result["method"]["arc_nodes"]] == [1, 1, 1]
    assert sum(sum(counts) for counts in result["method"]["arc_nodes"]) + 3 + 1 == len(result["nodes"]["t"])
    seconds = result["statistics"]["seconds"]
    assert seconds["refine"] > 0.0
    assert sum(seconds[part] for part in ("build", "solve", "refine", "verify")) <= seconds["total"]
    assert len(result["convergence"]) >= 2
    checks = {check["name"]: check for check in result["verification"]["checks"]}
    assert checks["switching_sign"]["limit"] == 1e-3
    assert checks["switching_sign"]["value"] <= 1e-6
    assert checks["hamiltonian_drift"]["value"] <= 1e-7
    assert set(result["verification"]["tolerances"].values()) == {1e-6}


def test_samples_hold_both_values_of_a_control_that_jumps() -> None:
    document = load_case("flexible_spacecraft")
    result = refined(document, "swcm").result()
    times = np.array(result["trajectory"]["t"])
    torque = np.array(result["trajectory"]["controls"]["T"])
    for switch, before, after in zip(result["switching"]["T"]["times"], (5, -5, 5), (-5, 5, -5), strict=True):
        values = torque[times == switch]
        assert values.size >= 2
        assert values[[0, -1]].tolist() == pytest.approx([before, after], abs=1e-12)
    again = Trajectory.from_result(result)
    switch = result["switching"]["T"]["times"][0]
    both = again.sample(np.array([0.0, switch, switch, 20.0]))
    assert both["controls"]["T"] == pytest.approx([5, 5, -5, -5], abs=1e-12)
    assert again.sample(np.array([switch]))["controls"]["T"] == pytest.approx([-5], abs=1e-12)
    assert both["states"]["theta"][1] == pytest.approx(both["states"]["theta"][2], abs=1e-13)


def test_several_controls_that_switch_at_their_own_times() -> None:
    """Thrusters in both directions: at rest to 1 away in 3 s with least fuel takes 3 - sqrt(5)."""
    solution = refined(
        {
            "problem": {
                "model": {
                    "kind": "first_order",
                    "states": ["x", "v"],
                    "controls": ["p", "n"],
                    "dynamics": {"x": "v", "v": "p - n"},
                },
                "final_time": 3,
                "initial_state": {"*": 0},
                "final_state": {"x": 1, "v": 0},
                "bounds": {"p": [0, 1], "n": [0, 1]},
                "objective": {"running": "p + n"},
            }
        }
    )
    assert solution.success, solution.message
    burn = (3.0 - np.sqrt(5.0)) / 2.0
    assert solution.objective == pytest.approx(2.0 * burn, abs=1e-12)
    assert solution.switching["p"]["times"] == pytest.approx([burn], abs=1e-10)
    assert solution.switching["n"]["times"] == pytest.approx([3.0 - burn], abs=1e-10)
    assert solution.switching["n"]["arcs"] == ["lower", "upper"]


def test_arcs_that_a_mesh_does_not_see_are_found_by_the_sign_of_the_switching_function() -> None:
    """On five intervals, the two middle arcs of the slew, a twentieth of it each, are nowhere to be seen."""
    document = load_case("flexible_spacecraft")
    document["method"] = {"name": "hermite_simpson", "intervals": 5, "refine": "switching"}
    solution = solve(check_document(document))
    assert solution.success, solution.message
    assert solution.objective == pytest.approx(25.866100388133, abs=1e-8)
    assert len(solution.switching["T"]["arcs"]) == 4


def test_a_refinement_that_fails_keeps_the_first_answer_and_says_why() -> None:
    document = load_case("bryson_denham")
    plain = solve(check_document({**document, "options": {"max_iterations": 18}}))
    assert plain.success
    solution = refined(document, max_iterations=18)
    assert solution.status is SolveStatus.UNVERIFIED
    assert "refine" in solution.message
    assert solution.objective == plain.objective
    result = solution.result()
    assert result["method"]["refine"] is None
    (warning,) = result["warnings"]
    assert (warning["code"], warning["pointer"]) == ("refinement_failed", "/method/refine")
    assert "iteration_limit" in warning["detail"]
    assert result["verification"]["tolerances"]["state_error"] == 1e-6
    assert "switching_sign" not in {check["name"] for check in result["verification"]["checks"]}


class Recorder:
    """Keeps the reports; asks to stop as soon as a refinement runs."""

    def __init__(self, *, stops: bool) -> None:
        self.reports: list[ProgressReport] = []
        self._stops = stops

    def report(self, report: ProgressReport) -> None:
        self.reports.append(report)

    def cancelled(self) -> bool:
        return self._stops and any(report.stage.startswith("switching") for report in self.reports)


def spec_of(case: str) -> Any:
    return check_document({**load_case(case), "method": {"name": "swcm", "refine": "switching"}})


def test_progress_never_goes_back() -> None:
    recorder = Recorder(stops=False)
    solve(spec_of("min_time_orbit_transfer"), recorder)
    fractions = [report.fraction for report in recorder.reports]
    assert fractions == sorted(fractions)
    assert "switching 2" in {report.stage for report in recorder.reports}


def test_a_cancelled_refinement_keeps_the_first_answer() -> None:
    solution = solve(spec_of("goddard"), Recorder(stops=True))
    assert solution.status is SolveStatus.CANCELLED
    assert solution.objective == pytest.approx(-1.0128369, abs=1e-5)


@pytest.mark.parametrize("case", ["flexible_spacecraft", "min_time_orbit_transfer", "van_der_pol"])
def test_the_error_estimate_is_the_true_error_of_the_states(case: str) -> None:
    """Against the flight from node to node."""
    solution = refined(load_case(case))
    verification = solution.verification
    assert verification.mesh_error_estimate is not None
    assert verification.max_state_error is not None
    assert verification.mesh_error_estimate <= 1e-8
    if verification.max_state_error > 1e-11:
        assert 0.3 < verification.mesh_error_estimate / verification.max_state_error < 3.0


def test_the_control_returned_flies_to_the_target_by_itself() -> None:
    """One flight from start to end with no help from the returned states."""
    solution = refined(load_case("flexible_spacecraft"))
    trajectory = solution.trajectory
    model = ControlledModel(solution.problem, trajectory, np.ones(4), np.inf)
    state = np.zeros((4, 1))
    for arc in range(model.arcs):
        state = model.integrate(state, np.array([arc])).ends
    np.testing.assert_allclose(state[:, 0], [np.pi / 6, 0, 0, 0], rtol=0, atol=1e-9)


def resumed(document: dict[str, Any], earlier: Trajectory) -> Solution:
    """Solve from an earlier answer, as it comes back from its result."""
    document = {**document, "warm_start": "01a22022-d193-7d62-9f31-f11c2ab70755"}
    return solve(check_document(document), None, earlier)


def read_back(solution: Solution) -> Trajectory:
    return Trajectory.from_result(json.loads(json.dumps(solution.result())))


@pytest.mark.parametrize("stiffness", [101, 110, 80])
def test_a_neighbour_is_solved_from_the_structure_alone(stiffness: float) -> None:
    document = load_case("flexible_spacecraft")
    document["method"] = {"name": "swcm", "J": 4, "refine": "switching"}
    earlier = read_back(solve(check_document(document)))
    document["problem"]["model"]["parameters"]["k"] = stiffness
    cold, warm = solve(check_document(document)), resumed(document, earlier)
    assert warm.success
    assert warm.objective == pytest.approx(cold.objective, abs=1e-9)
    assert warm.switching["T"]["times"] == pytest.approx(cold.switching["T"]["times"], abs=1e-6)
    assert len(warm.convergence) == 1
    assert warm.statistics.iterations < cold.statistics.iterations / 2


def test_answers_in_a_row_predict_the_next_one() -> None:
    """And an answer begins with its own switches, so that it obeys the model from the start."""
    document = load_case("flexible_spacecraft")
    document["method"] = {"name": "swcm", "J": 4, "refine": "switching"}
    stiffnesses, answers = [100.0, 100.2, 100.4], [solve(check_document(document))]
    for stiffness in stiffnesses[1:]:
        document["problem"]["model"]["parameters"]["k"] = stiffness
        answers.append(resumed(document, answers[-1].trajectory))
    again = resumed(document, answers[-1].trajectory)
    assert again.convergence[0]["iterates"][0][2] < 1e-10
    document["problem"]["model"]["parameters"]["k"] = 100.6
    start = predicted(stiffnesses[::-1], [answer.trajectory for answer in answers[::-1]], 100.6)
    ahead, warm = resumed(document, start), resumed(document, answers[-1].trajectory)
    assert ahead.success
    assert ahead.objective == pytest.approx(warm.objective, abs=1e-10)
    assert ahead.statistics.iterations < warm.statistics.iterations


def bryson_denham(limit: float) -> dict[str, Any]:
    document = load_case("bryson_denham")
    document["problem"]["bounds"]["x"] = [None, limit]
    document["method"] = {"name": "swcm", "refine": "switching"}
    return document


@pytest.mark.parametrize(
    ("limit", "objective"),
    [(1 / 8, 32 / 9), (1 / 5, 2 + 6 * (1 - 4 / 5) ** 2), (1 / 3, 2.0), (1 / 20, 80 / 9)],
    ids=["followed for less long", "only touched", "never met", "followed for longer"],
)
def test_a_structure_that_has_changed_is_seen(limit: float, objective: float) -> None:
    """A limit of 1/9 is followed, one of 1/5 touched, one of 1/3 never met (Bryson, Ho 1975, 3.11)."""
    warm = resumed(bryson_denham(limit), read_back(solve(check_document(bryson_denham(1 / 9)))))
    assert warm.success, warm.message
    assert warm.objective == pytest.approx(objective, abs=1e-9)


def test_an_answer_in_other_names_is_a_start_and_no_structure() -> None:
    document = load_case("rigid_body")
    document["method"] = {"name": "swcm", "refine": "switching"}
    earlier = solve(check_document(bryson_denham(1 / 9))).trajectory
    assert resumed(document, earlier).objective == pytest.approx(2.0, abs=1e-10)
