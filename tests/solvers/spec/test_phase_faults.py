"""What is wrong with phases and links is said at their own place."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from solvers.errors import DocumentError
from solvers.spec import check_document
from tests.solvers.conftest import INTEGRATOR

OTHER_MODEL = {"kind": "first_order", "states": ["y"], "controls": ["u"], "dynamics": {"y": "u"}}
DOCUMENT: dict[str, Any] = {
    "problem": {
        "model": INTEGRATOR,
        "final_time": 1,
        "initial_state": {"x": 1},
        "objective": {"running": "(x^2 + u^2)/2"},
        "phases": [{"name": "one", "final_time": [0.1, 0.9]}, {"name": "two"}],
    },
    "method": {"name": "gpm"},
}


def faults(**changes: Any) -> dict[str, str]:
    """The details by pointer; ``first`` and ``second`` change the phases, other keys the problem."""
    document = copy.deepcopy(DOCUMENT)
    problem = document["problem"]
    for key, value in changes.items():
        match key:
            case "first" | "second":
                problem["phases"][key == "second"].update(value)
            case "method" | "output" | "warm_start":
                document[key] = value
            case _:
                problem[key] = value
    try:
        check_document(document)
    except DocumentError as error:
        return {fault.pointer: fault.detail for fault in error.faults}
    return {}


@pytest.mark.parametrize(
    ("changes", "pointer", "words"),
    [
        ({"links": [{"from": "one", "to": "tow"}]}, "/problem/links/0/to", "did you mean 'two'"),
        ({"links": [{"from": "two", "to": "one"}]}, "/problem/links/0/to", "no phase follows 'two'"),
        ({"links": [{"from": "one", "to": "two", "jump": {"z": 1}}]}, "/problem/links/0/jump/z", "unknown"),
        (
            {"links": [{"from": "one", "to": "two", "jump": {"x": "x_0"}}]},
            "/problem/links/0/jump/x",
            "did you mean 'x_f'",
        ),
        ({"links": [{"from": "one", "to": "two", "jmp": {}}]}, "/problem/links/0/jmp", "'jump'"),
        ({"links": [{"from": "one", "to": "two"}] * 2}, "/problem/links/1/to", "already"),
        ({"phases": [], "links": [{"from": "one", "to": "two"}]}, "/problem/links", "there are none"),
        ({"second": {"name": "one"}}, "/problem/phases/1/name", "already"),
        ({"second": {"name": ["two"]}}, "/problem/phases/1/name", "must be text, not a list"),
        ({"links": [{"from": "one", "to": {}}]}, "/problem/links/0/to", "must be text, not an object"),
        ({"second": {"name": "a b"}}, "/problem/phases/1/name", "is not a name"),
        ({"second": {"fnal_time": 3}}, "/problem/phases/1/fnal_time", "did you mean 'final_time'"),
        ({"second": {"final_time": 0.05}}, "/problem/phases/1/final_time", "is not after"),
        ({"second": {"bounds": {"uu": 0}}}, "/problem/phases/1/bounds/uu", "did you mean 'u'"),
        ({"second": {"bounds": {"u": [1, 0]}}}, "/problem/phases/1/bounds/u", "crossed"),
        (
            {"second": {"bounds": {"x": [0, 1]}, "final_state": {"x": 2}}},
            "/problem/phases/1/final_state/x",
            "outside its bounds",
        ),
        ({"second": {"parameters": {"h": 3}}}, "/problem/phases/1/parameters/h", "unknown parameter"),
        ({"second": {"parameters": {"a": "k"}}}, "/problem/phases/1/parameters/a", "unknown name 'k'"),
        (
            {"second": {"path_constraints": [{"expression": "xx", "bounds": 0}]}},
            "/problem/phases/1/path_constraints/0/expression",
            "unknown name 'xx'",
        ),
        ({"second": {"model": OTHER_MODEL}}, "/problem/phases/1", "no state 'y'"),
        (
            {"second": {"model": {**OTHER_MODEL, "dynamics": {"y": "v"}}, "initial_state": {"y": 0}}},
            "/problem/phases/1/model/dynamics/y",
            "unknown name 'v'",
        ),
        (
            {"second": {"model": OTHER_MODEL, "initial_state": {"y": 0}}, "final_state": {"x": 0}},
            "/problem/final_state",
            "a model of its own",
        ),
        (
            {"second": {"model": OTHER_MODEL, "initial_state": {"y": 0}}, "objective": {"terminal": "x_f"}},
            "/problem/objective/terminal",
            "the last phase knows no 'x_f'",
        ),
        (
            {
                "phases": [{"name": "own", "model": OTHER_MODEL, "initial_state": {"y": 0}}],
                "initial_state": {},
                "objective": {"maximum": "u"},
            },
            "/problem/objective/maximum",
            "in its own objective",
        ),
        ({"initial_state": {}}, "/problem/initial_state", "'x' is missing"),
        ({"bounds": {"u": [1, 0]}}, "/problem/bounds/u", "crossed"),
        (
            {"output": {"command": {"period": 0.1, "quantum": {"v": 1}}}},
            "/output/command/quantum/v",
            "unknown control 'v'",
        ),
        ({"phases": 3}, "/problem/phases", "must be a list"),
        ({"phases": [3]}, "/problem/phases/0", "must be an object"),
        ({"phases": [{"name": f"p{k}"} for k in range(17)]}, "/problem/phases", "at most 16"),
    ],
)
def test_a_mistake_is_named_where_it_stands(changes: dict[str, Any], pointer: str, words: str) -> None:
    found = faults(**changes)
    assert set(found) == {pointer}, found
    assert words in found[pointer]


def test_what_stands_beside_phases_that_say_all_of_it() -> None:
    """As the messages about keys that are missing say."""
    phase = {"model": OTHER_MODEL, "objective": {"running": "u^2"}}
    document: dict[str, Any] = {
        "problem": {
            "phases": [
                {**phase, "name": "one", "final_time": 1, "initial_state": {"y": 0}},
                {**phase, "name": "two", "final_time": 2, "final_state": {"y": 1}},
            ]
        }
    }
    with pytest.raises(DocumentError) as caught:
        check_document(document)
    found = {fault.pointer: fault.detail for fault in caught.value.faults}
    assert set(found) == {f"/problem/{key}" for key in ("model", "final_time", "initial_state", "objective")}
    assert all("beside phases too: " in detail for detail in found.values())
    document["problem"] |= {
        "model": OTHER_MODEL,
        "final_time": [1, 3],
        "initial_state": {},
        "objective": {"terminal": 0},
    }
    assert check_document(document).problem.phases[1].name == "two"


def test_every_mistake_is_reported_at_once() -> None:
    found = faults(
        first={"bounds": {"uu": 0}}, second={"final_state": {"z": 0}}, links=[{"from": "one", "to": "tow"}]
    )
    assert set(found) == {
        "/problem/phases/0/bounds/uu",
        "/problem/phases/1/final_state/z",
        "/problem/links/0/to",
    }


@pytest.mark.parametrize(
    ("changes", "pointer"),
    [
        ({"method": {"name": "ga"}}, "/method/name"),
        ({"method": {"name": "piecewise", "segments": {"by": "time", "length": 1}}}, "/method/name"),
    ],
)
def test_what_is_not_done_yet(changes: dict[str, Any], pointer: str) -> None:
    found = faults(**changes)
    assert set(found) == {pointer}, found
    assert found[pointer].startswith("unsupported: ")
