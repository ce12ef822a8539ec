"""Scenarios that are refused, and where."""

from __future__ import annotations

from typing import Any

import pytest

from tests.solvers.spec.editing import FLEXIBLE_SPACECRAFT, LIBRARY, edited, faults_of

SOFT = {"name": "soft", "parameters": {"k": 90}}
PLACE = "/problem/scenarios"
FAULTS: list[tuple[Any, str, str]] = [
    ([], "", "must be an object"),
    ({}, "/cases", "is required"),
    ({"cases": []}, "/cases", "at least one case"),
    ({"cases": {}}, "/cases", "must be a list"),
    ({"cases": [3]}, "/cases/0", "must be an object"),
    ({"cases": [{}]}, "/cases/0/name", "is required"),
    ({"cases": [{"name": "a b"}]}, "/cases/0/name", "letters, digits"),
    ({"cases": [{"name": "nominal"}]}, "/cases/0/name", "without a case"),
    ({"cases": [{"name": "x" * 65}]}, "/cases/0/name", "64 characters"),
    ({"cases": [SOFT, SOFT]}, "/cases/1/name", "already taken by a case"),
    ({"cases": [{**SOFT, "parameter": {}}]}, "/cases/0/parameter", "did you mean 'parameters'"),
    ({"cases": [{"name": "a", "parameters": {"kk": 1}}]}, "/cases/0/parameters/kk", "did you mean 'k'"),
    ({"cases": [{"name": "a", "parameters": {"k": "theta"}}]}, "/cases/0/parameters/k", "cannot be used"),
    ({"cases": [{"name": "a", "parameters": {"R": "k/40"}}]}, "/cases/0/parameters/R", "'k' comes later"),
    ({"cases": [{"name": "a", "parameters": {"k": "1/0"}}]}, "/cases/0/parameters/k", "not a finite"),
    ({"cases": [{"name": "a", "bounds": {"T": [-1, 1]}}]}, "/cases/0/bounds/T", "common to all cases"),
    ({"cases": [{"name": "a", "bounds": {"beta": 1}}]}, "/cases/0/bounds/beta", "unknown state"),
    ({"cases": [{"name": "a", "final_state": {"alpa": 1}}]}, "/cases/0/final_state/alpa", "'alpha'"),
    (
        {"cases": [{"name": "a", "bounds": {"alpha": [1, 2]}}]},
        "/cases/0/bounds/alpha",
        "in this case /problem/initial_state/alpha",
    ),
    (
        {"cases": [{"name": "a", "bounds": {"alpha": [-1, 1]}, "final_state": {"alpha": 2}}]},
        "/cases/0/final_state/alpha",
        "outside its bounds [-1, 1]",
    ),
    ({"cases": [{"name": "a", "parameters": {"m": 0}}]}, "/cases/0/parameters", "singular at the start"),
    ({"cases": [SOFT], "nominal": 1}, "/nominal", "true or false"),
    ({"cases": [SOFT], "nominal": False, "objective": "nominal"}, "/objective", "is no plant here"),
    ({"cases": [SOFT], "objective": "best"}, "/objective", "'nominal', 'mean' or 'worst'"),
    ({"cases": [{"name": f"c{i}"} for i in range(17)]}, "/cases", "at most 16 cases"),
]


@pytest.mark.parametrize(("scenarios", "place", "word"), FAULTS)
def test_faults(scenarios: Any, place: str, word: str) -> None:
    faults = faults_of(edited({PLACE: scenarios}))
    assert (PLACE + place) in [fault.pointer for fault in faults], faults
    assert word in next(fault.detail for fault in faults if fault.pointer == PLACE + place)
    assert all(fault.pointer.startswith(PLACE) for fault in faults)
    # Whatever else is wrong, it is told as well.
    others = faults_of(edited({PLACE: scenarios, "/problem/bounds/T": [5, -5]}))
    assert {fault.pointer for fault in others} == {*(fault.pointer for fault in faults), "/problem/bounds/T"}


def test_a_design_parameter_is_common() -> None:
    changes = {"/problem/design": {"k": {"bounds": [90, 110]}}, PLACE: {"cases": [SOFT]}}
    assert [fault.pointer for fault in faults_of(edited(changes))] == [f"{PLACE}/cases/0/parameters/k"]


@pytest.mark.parametrize("base", [FLEXIBLE_SPACECRAFT, LIBRARY])
def test_what_is_right_is_accepted(base: dict[str, Any]) -> None:
    cases = [
        SOFT,
        {"name": "95.5", "parameters": {"k": "2*m + 75.5"}, "final_state": {"alpha": [-1e-4, 1e-4]}},
    ]
    for scenarios in ({"cases": cases}, {"cases": cases, "nominal": False, "objective": "worst"}):
        assert faults_of(edited({PLACE: scenarios}, base)) == ()
