"""Integrals, design parameters, windows and control ends: what is refused, and where."""

from __future__ import annotations

from typing import Any

import pytest

from tests.solvers.spec.editing import FLEXIBLE_SPACECRAFT, LIBRARY, edited, faults_of

IMPULSE = {"name": "impulse", "expression": "T^2", "bounds": [None, 40]}
CONSTRAINT = {"expression": "T", "bounds": [-1, 1]}
FAULTS: list[tuple[dict[str, Any], str, str]] = [
    ({"/problem/integrals": [{"expression": "T"}]}, "/problem/integrals/0/name", "is required"),
    ({"/problem/integrals": [{**IMPULSE, "bound": 1}]}, "/problem/integrals/0/bound", "'bounds'"),
    ({"/problem/integrals": [{**IMPULSE, "bounds": [2, 1]}]}, "/problem/integrals/0/bounds", "crossed"),
    ({"/problem/integrals": [IMPULSE, IMPULSE]}, "/problem/integrals/1/name", "already taken"),
    ({"/problem/integrals": [{**IMPULSE, "name": "tf"}]}, "/problem/integrals/0/name", "is reserved"),
    ({"/problem/integrals": [{**IMPULSE, "name": "alpha"}]}, "/problem/integrals/0/name", "already taken"),
    (
        {"/problem/integrals": [IMPULSE], "/problem/objective": {"running": "impulse"}},
        "/problem/objective/running",
        "'impulse' cannot be used here",
    ),
    ({"/problem/objective": {"terminal": "impulse"}}, "/problem/objective/terminal", "unknown name"),
    ({"/problem/design": {"Rr": {"bounds": [1, 4]}}}, "/problem/design/Rr", "did you mean 'R'"),
    ({"/problem/design": {"alpha": {"bounds": [1, 4]}}}, "/problem/design/alpha", "no parameter"),
    ({"/problem/design": {"R": {}}}, "/problem/design/R/bounds", "is required"),
    ({"/problem/design": {"R": 3}}, "/problem/design/R", "must be an object"),
    ({"/problem/design": {"R": {"bounds": [1, 4], "gues": 2}}}, "/problem/design/R/gues", "'guess'"),
    ({"/problem/design": {"R": {"bounds": [1, 4], "guess": 5}}}, "/problem/design/R/guess", "outside"),
    (
        {"/problem/design": {"R": {"bounds": [1, 4]}}, "/problem/bounds/T": ["-R", 5]},
        "/problem/bounds/T/0",
        "'R' is a design parameter",
    ),
    (
        {
            "/problem/model/parameters/RR": "2*R",
            "/problem/design": {"R": {"bounds": [1, 4]}},
            "/problem/final_state/theta": "RR",
        },
        "/problem/final_state/theta",
        "'RR' is a design parameter or follows from one",
    ),
    ({"/problem/initial_control": {"theta": 0}}, "/problem/initial_control/theta", "is a state"),
    ({"/problem/final_control": {"TT": 0}}, "/problem/final_control/TT", "did you mean 'T'"),
    ({"/problem/final_control": {"T": 6}}, "/problem/final_control/T", "outside its bounds [-5, 5]"),
]
FAULTS += [
    ({"/problem/control_rates": {"theta": 1}}, "/problem/control_rates/theta", "is a state"),
    ({"/problem/control_rates": {"TT": [-1, 1]}}, "/problem/control_rates/TT", "did you mean 'T'"),
    ({"/problem/control_rates": {"T": [1, -1]}}, "/problem/control_rates/T", "crossed"),
    (
        {"/problem/path_constraints": [{"expression": "T_dot", "bounds": 0}]},
        "/problem/path_constraints/0/expression",
        "only where control_rates bounds the rate",
    ),
    (
        {"/problem/control_rates": {"T": [-1, 1]}, "/problem/model/force": ["T_dot", 0]},
        "/problem/model/force/0",
        "cannot be used here",
    ),
]
FAULTS += [
    ({"/output/command": {}}, "/output/command/period", "is required"),
    ({"/output/command": {"period": 0}}, "/output/command/period", "greater than 0"),
    ({"/output/command": {"period": 1, "rule": "mean"}}, "/output/command/rule", "'average' or 'sample'"),
    ({"/output/command": {"period": 1, "delay": -1}}, "/output/command/delay", "at least 0"),
    ({"/output/command": {"period": 1, "quantum": {"T": 0}}}, "/output/command/quantum/T", "greater than 0"),
    ({"/output/command": {"period": 1, "quantum": {"U": 1}}}, "/output/command/quantum/U", "unknown control"),
    ({"/output/command": {"periode": 1, "period": 1}}, "/output/command/periode", "'period'"),
    ({"/output/coast": -1}, "/output/coast", "greater than 0"),
    ({"/output/coast": "long"}, "/output/coast", "unknown name"),
]
WINDOWS: list[tuple[Any, str, str]] = [
    ([0.5, 0.2], "", "start <= end"),
    ([0, 2], "", "<= 1"),
    (0.5, "", "[start, end]"),
    ([0, None], "/1", "must be a number"),
    ([0, "theta"], "/1", "cannot be used"),
]


@pytest.mark.parametrize(
    ("changes", "pointer", "word"),
    [
        *FAULTS,
        *(
            (
                {"/problem/path_constraints": [{**CONSTRAINT, "during": window}]},
                f"/problem/path_constraints/0/during{place}",
                word,
            )
            for window, place, word in WINDOWS
        ),
    ],
)
def test_faults(changes: dict[str, Any], pointer: str, word: str) -> None:
    faults = faults_of(edited(changes))
    assert [fault.pointer for fault in faults] == [pointer], faults
    assert word in faults[0].detail


def test_what_is_right_is_accepted() -> None:
    changes = {
        "/problem/integrals": [IMPULSE, {"name": "work", "expression": "T*theta_dot"}],
        "/problem/design": {"R": {"bounds": [1, 4], "guess": "2*1.25"}, "L": {"bounds": 5}},
        "/problem/path_constraints": [{**CONSTRAINT, "during": ["1/4", 1]}],
        "/problem/boundary_constraints": [{"expression": "R*tf + work", "bounds": [0, None]}],
        "/problem/objective/terminal": "tf + impulse/L",
        "/problem/initial_control": {"T": 0},
        "/problem/control_rates": {"T": [None, 3]},
        "/problem/outputs": [{"name": "slope", "expression": "T_dot"}],
        "/problem/final_control": {"T": [None, 0]},
    }
    for base in (FLEXIBLE_SPACECRAFT, LIBRARY):
        assert faults_of(edited(changes, base)) == ()
