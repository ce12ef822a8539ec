"""Flights of phases that start from earlier answers: of the same phases, of others, of none."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np
import pytest

from solvers.errors import DocumentError
from solvers.part import Part
from solvers.phases.reading import phased_problem
from solvers.phases.trajectory import AnyTrajectory, trajectory_of
from solvers.solve import solve
from solvers.spec import check_document
from solvers.start.earlier import starts_from
from solvers.start.scaling import automatic_scaling
from tests.solvers.conftest import REGULATOR, RIGID_BODY
from tests.solvers.output.test_outputs import result_of
from tests.solvers.phases.test_better_phases import cut
from tests.solvers.phases.test_phases import ROCKET, SLIDE_AND_ROLL

Document = dict[str, Any]

GPM = {"name": "gpm", "nodes": 12}


def stored(document: Document) -> Document:
    """The result of a document as a store gives it back."""
    return json.loads(json.dumps(result_of(document)))


def warm(document: Document, earlier: AnyTrajectory) -> Document:
    named = check_document({**document, "warm_start": "01a22022-d193-7d62-9f31-f11c2ab70755"})
    return solve(named, earlier=earlier).result()


def codes(result: Document) -> list[tuple[str, str]]:
    return [(item["code"], item["pointer"]) for item in result["warnings"]]


@pytest.fixture(scope="module")
def rocket() -> Document:
    return stored(ROCKET)


@pytest.mark.parametrize("method", [{"name": "swcm", "J": 4}, {"name": "auto"}], ids=["mesh", "choice"])
def test_the_same_phases_of_another_mesh_and_other_parameters(
    rocket: Document, method: dict[str, Any]
) -> None:
    document = {**copy.deepcopy(ROCKET), "method": method}
    document["problem"]["model"]["parameters"]["D"] = 0.11
    cold, again = result_of(document), warm(document, trajectory_of(rocket))
    assert again["success"], again["message"]
    assert again["objective"] == pytest.approx(cold["objective"], abs=1e-10)
    assert again["statistics"]["iterations"] < cold["statistics"]["iterations"] / 2
    assert codes(again) == []


def test_arcs_of_every_phase_are_tried_first() -> None:
    """A unit of way with |u| <= 1 takes 2 sqrt(m), wherever it is cut."""
    document = cut(RIGID_BODY, {"final_state": {"x": 0.3}}, {}, method={**GPM, "refine": "switching"})
    earlier = trajectory_of(stored(document))
    document["problem"]["model"]["parameters"]["m"] = 1.44
    cold, again = result_of(document), warm(document, earlier)
    assert again["success"], again["message"]
    assert again["objective"] == pytest.approx(2.4, abs=1e-9)
    assert again["statistics"]["iterations"] < cold["statistics"]["iterations"]
    assert {item["stage"].split()[0] for item in again["convergence"]} == {"switching"}


@pytest.mark.parametrize(
    ("before", "now", "told"),
    [
        ([], [("a", 0.7), ("b", None)], "'a' starts from what was flown from 0 to 0.7; "),
        ([("a", 0.6), ("b", None)], [], "the flight starts from what was flown from 0 to 1"),
        ([("a", 0.6), ("b", None)], [("c", 0.6), ("d", None)], "'c' starts from 'a'; 'd' starts from 'b'"),
        (
            [("a", 0.2), ("b", 0.8), ("c", None)],
            [("a", 0.2), ("x", 0.3), ("y", 0.8), ("c", None)],
            "'a' starts from 'a'; 'x' starts from what was flown from 0.2 to 0.3; 'y' starts from what was ",
        ),
        ([], [("all", None)], "'all' starts from the whole of it"),
    ],
)
def test_other_phases_start_from_what_was_flown_at_their_times(
    before: list[tuple[str, float]], now: list[tuple[str, float]], told: str
) -> None:
    """The regulator: x = cosh(1 - t)/cosh(1), u = -sinh(1 - t)/cosh(1), J = tanh(1)/2, however it is cut."""

    def flown(phases: list[tuple[str, float]]) -> Document:
        parts = [{"name": name, "final_time": time} if time else {"name": name} for name, time in phases]
        return {
            **copy.deepcopy(REGULATOR),
            "method": GPM,
            "problem": {**REGULATOR["problem"], "phases": parts},
        }

    earlier = trajectory_of(stored(flown(before)))
    result = warm(flown(now), earlier)
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(np.tanh(1) / 2, abs=1e-10)
    assert result["convergence"][0]["iterates"][0][1] == pytest.approx(np.tanh(1) / 2, abs=1e-4)
    assert codes(result) == [("other_phases", "/warm_start")]
    assert told in result["message"]
    if now:
        problems = [phase.problem for phase in phased_problem(check_document(flown(now)).problem).phases]
        names = [name for name, _ in now]
        pairs = zip(problems, names, strict=True)
        parts = [Part(problem, automatic_scaling(problem), name) for problem, name in pairs]
        tau = np.linspace(0, 1, 17)
        for start in starts_from(earlier, parts):
            t = start.t0 + (start.tf - start.t0) * tau
            assert start.states_at(tau)[0] == pytest.approx(np.cosh(1 - t) / np.cosh(1), abs=1e-9)
            assert start.controls_at(tau)[0] == pytest.approx(-np.sinh(1 - t) / np.cosh(1), abs=1e-6)


def test_a_phase_that_was_not_flown_begins_with_the_guess_behind_the_one_before() -> None:
    """Rolls for half a second only: x1^2 + 12 (1 - x1)^2/T^3 with T = 1/2 is least for x1 = 96/97."""
    document = copy.deepcopy(SLIDE_AND_ROLL)
    document["problem"]["phases"].insert(1, {"name": "rest", "final_time": 1.5, "bounds": {"u": 0}})
    document["problem"]["links"][0]["from"] = "rest"
    result = warm(document, trajectory_of(stored(SLIDE_AND_ROLL)))
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(96 / 97, abs=1e-9)
    assert "'rest' starts from the guess; 'roll' starts from 'roll'" in result["message"]


@pytest.mark.parametrize("document", [ROCKET, SLIDE_AND_ROLL], ids=["one model", "a model each"])
def test_the_nodes_of_a_result_with_phases_are_a_guess(document: Document) -> None:
    """Phases without a state have null there, and where two meet a time stands twice."""
    cold, guessed = stored(document), copy.deepcopy(document)
    guessed["problem"]["guess"] = {"from_result": cold["nodes"]}
    started = phased_problem(check_document(guessed).problem)
    for phase, own in zip(started.phases, cold["phases"], strict=True):
        guess, (first, last) = phase.problem.guess, own["nodes"]
        assert (guess.t0, guess.tf) == pytest.approx((own["t0"], own["tf"]), abs=1e-12)
        tau = (np.array(cold["nodes"]["t"][first : last + 1]) - own["t0"]) / (own["tf"] - own["t0"])
        for name, row in zip(phase.problem.states, guess.states_at(tau), strict=True):
            assert row == pytest.approx(cold["nodes"]["states"][name][first : last + 1], abs=1e-12)
    result = result_of(guessed)
    assert result["objective"] == pytest.approx(cold["objective"], abs=1e-10)
    assert result["statistics"]["iterations"] < cold["statistics"]["iterations"]


def test_they_are_a_guess_of_other_phases_too(rocket: Document) -> None:
    document = copy.deepcopy(ROCKET)
    document["problem"]["phases"].insert(0, {"name": "ignition", "final_time": 0.1})
    document["problem"]["guess"] = {"from_result": rocket["nodes"]}
    guesses = [phase.problem.guess for phase in phased_problem(check_document(document).problem).phases]
    assert guesses[0].states_at(np.ones(1))[2, 0] == pytest.approx(
        np.interp(0.1, rocket["nodes"]["t"], rocket["nodes"]["states"]["m"]), abs=1e-12
    )
    assert result_of(document)["objective"] == pytest.approx(rocket["objective"], abs=1e-8)


@pytest.mark.parametrize(
    ("nodes", "pointer"),
    [
        ({"t": [0, 0, 1]}, "/t/1"),
        ({"t": [0, 1, 1, 1, 2]}, "/t/3"),
        ({"t": [0, 1, 1]}, "/t/2"),
        ({"t": [0, 1, 2], "states": {"h": [0, None, 1]}}, "/states/h/1"),
        ({"t": [0, 1, 1, 2], "states": {"y": [0, 1, None, None]}}, "/states/y"),
    ],
)
def test_nodes_that_are_not_nodes_are_refused(nodes: dict[str, Any], pointer: str) -> None:
    document = copy.deepcopy(ROCKET)
    document["problem"]["guess"] = {"from_result": nodes}
    with pytest.raises(DocumentError) as caught:
        check_document(document)
    assert [fault.pointer for fault in caught.value.faults] == [f"/problem/guess/from_result{pointer}"]
