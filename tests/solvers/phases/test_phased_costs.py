"""Peaks over a whole flight, and what the phases of several plants cost by themselves: closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.sizes import problem_size
from solvers.spec import check_document
from tests.solvers.conftest import INTEGRATOR
from tests.solvers.output.test_outputs import each_method, result_of

Document = dict[str, Any]

CUT = [{"name": "one", "final_time": 0.25}, {"name": "two", "final_time": 0.5}, {"name": "three"}]


def ramp(*phases: Document, **problem: Any) -> Document:
    """x' = u by 1 in a second; the peak of u + t is least where it is 3/2 from end to end."""
    return {
        "problem": {
            "model": INTEGRATOR,
            "final_time": 1,
            "initial_state": {"x": 0},
            "final_state": {"x": 1},
            "objective": {"maximum": "a*(u + t)"},
            "phases": list(phases),
            **problem,
        },
        "method": {"name": "gpm", "nodes": 6},
    }


def checked(document: Document, objective: float, flown: float | None = None) -> Document:
    """The result, whose objective is known; ``flown``: that of the leading plant, where it is another one."""
    result = result_of(document)
    assert result["success"], result["message"]
    assert result["objective"] == pytest.approx(objective, abs=1e-7)
    expected = objective if flown is None else flown
    assert result["verification"]["objective"] == pytest.approx(expected, abs=1e-6)
    size, told = problem_size(check_document(document)), result["statistics"]
    assert (size.variables, size.constraints) == (told["variables"], told["constraints"])
    return result


@each_method
def test_a_peak_over_the_whole_flight_is_that_of_no_phase_alone(method: dict[str, Any]) -> None:
    result = checked({**ramp(*CUT), "method": method}, 1.5)
    nodes = result["nodes"]
    assert nodes["controls"]["u"] == pytest.approx(1.5 - np.array(nodes["t"]), abs=1e-6)
    assert result["design"] == {}
    # The peak is the way, and half of a second, over a second.
    assert result["sensitivity"]["/problem/final_state/x"] == pytest.approx(1, abs=1e-6)


def test_it_counts_beside_the_costs_of_phases_and_through_jumps() -> None:
    """A quarter of the way is leapt over; the last phase also pays the peak of -u, which is 1/4 there."""
    links = [{"from": "one", "to": "two", "jump": {"x": "x_f + 0.25"}}]
    phases = [*CUT[:2], {"name": "three", "objective": {"terminal": "tf", "maximum": "abs(u - 1.25 + t)"}}]
    result = checked(ramp(*phases, links=links, objective={"maximum": "u + t", "terminal": "x_f"}), 3.25)
    assert result["warnings"] == []


def test_a_phase_with_a_model_of_its_own_has_no_part_in_it() -> None:
    """By 1/4 in 1/4 s, with the peak 9/8; then y by 1 in 3/4 s with least energy, 4/3."""
    model = {"kind": "first_order", "states": ["y"], "controls": ["F"], "dynamics": {"y": "F"}}
    other = {
        "name": "other",
        "model": model,
        "initial_state": {"y": 0},
        "final_state": {"y": 1},
        "objective": {"running": "F^2"},
    }
    document = ramp({**CUT[0], "final_state": {"x": 0.25}}, other, final_state={})
    checked(document, 1.125 + 4 / 3)


@pytest.mark.parametrize(("choice", "objective"), [("mean", 2.25), ("worst", 3.0)])
def test_every_plant_has_a_peak(choice: str, objective: float) -> None:
    """Of a (u + t) with a of 1 and 2, over 1 or 2 times the way."""
    cases = [{"name": "strong", "parameters": {"a": 2}, "final_state": {"x": 2}}]
    checked(
        ramp(*CUT[:2], {"name": "three"}, scenarios={"cases": cases, "objective": choice}), objective, 1.5
    )


@pytest.mark.parametrize(("choice", "objective"), [("mean", 1.25), ("worst", 1.25)])
def test_costs_at_the_ends_of_phases_add_up_for_every_plant(choice: str, objective: float) -> None:
    """(x1 - b)^2 + (x2 - 2 b)^2 for b = 0 and 1: the worst, and the mean, are least halfway."""
    model = {**INTEGRATOR, "parameters": {"b": 0}, "dynamics": {"x": "u"}}
    phases = [
        {"name": "one", "final_time": 0.5, "objective": {"terminal": "(x_f - b)^2"}},
        {"name": "two", "objective": {"terminal": "(x_f - 2*b)^2"}},
    ]
    cases = [{"name": "far", "parameters": {"b": 1}}]
    several = {"cases": cases, "objective": choice}
    document = ramp(*phases, model=model, final_state={}, objective={"terminal": 0}, scenarios=several)
    result = checked(document, objective)
    if choice == "worst":
        assert result["trajectory"]["states"]["x"][-1] == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(("choice", "objective"), [("nominal", 1.75), ("worst", 3.5)])
def test_peaks_of_phases_add_up_for_every_plant(choice: str, objective: float) -> None:
    """a |u| over the first half, at rest, and a (u + t) over the second one, by 1/2: 1 + 3/4."""
    phases = [
        {"name": "one", "final_time": 0.5, "final_state": {"x": 0}, "objective": {"maximum": "a*abs(u)"}},
        {"name": "two", "objective": {"maximum": "a*(u + t)"}},
    ]
    cases = [{"name": "strong", "parameters": {"a": 2}, "final_state": {"x": 1}}]
    several = {"cases": cases, "objective": choice}
    document = ramp(*phases, final_state={"x": 0.5}, objective={"terminal": 0}, scenarios=several)
    checked(document, objective, 1.75)
