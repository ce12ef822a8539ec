"""What may be asked of flights: every mistake at its place, all at once."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from solvers.catalogue import load_case
from solvers.errors import DocumentError
from solvers.spec.flights import Distribution, check_flights, flights_schema
from tests.bad_documents import FLEXIBLE_SPACECRAFT

GOOD: dict[str, Any] = {
    "runs": 1000,
    "seed": 1,
    "use": "control",
    "parameters": {"k": {"uniform": ["0.9*k", 110]}},
    "initial_state": {"theta_dot": {"normal": [0, 1e-5]}},
    "actuator": {"T": {"lag": 0.1, "delay": 0.02}},
    "coast": 60,
}


def faults(asked: object, answered: dict[str, Any] = FLEXIBLE_SPACECRAFT) -> dict[str, tuple[str, str]]:
    """What is wrong, by pointer, with its type."""
    with pytest.raises(DocumentError) as refusal:
        check_flights(asked, answered)
    return {fault.pointer: (fault.type, fault.detail) for fault in refusal.value.faults}


def test_a_good_request_and_its_defaults() -> None:
    spec = check_flights(GOOD, FLEXIBLE_SPACECRAFT)
    assert spec.parameters == {"k": Distribution("uniform", (90.0, 110.0))}
    assert (spec.runs, spec.tolerance, spec.actuator_after) == (1000, 1e-2, "off")
    assert check_flights(spec.resolved(), FLEXIBLE_SPACECRAFT) == spec
    assert check_flights({}, FLEXIBLE_SPACECRAFT).use == "control"


BAD = [
    ("/runs", 0, "invalid", "at least 1"),
    ("/runs", 10_001, "limit", "10,000 runs"),
    ("/seed", 1.5, "invalid", "whole number"),
    ("/use", "comand", "invalid", "did you mean 'command'"),
    ("/sead", 1, "invalid", "did you mean 'seed'"),
    ("/coast", 0, "invalid", "greater than 0"),
    ("/tolerance", -1, "invalid", "greater than 0"),
    ("/worst", 101, "limit", "100"),
    ("/max_seconds", 1e4, "limit", "3,600 s"),
    ("/parameters", [], "invalid", "an object"),
    ("/parameters/K", {"uniform": [1, 2]}, "invalid", "did you mean 'k'"),
    ("/parameters/k", 3, "invalid", "an object with one of the keys"),
    ("/parameters/k", {"uniform": [1, 2], "normal": [1, 2]}, "invalid", "with 2 keys"),
    ("/parameters/k/unform", [1, 2], "invalid", "did you mean 'uniform'"),
    ("/parameters/k/uniform", [2, 1], "invalid", "crossed"),
    ("/parameters/k/uniform", [1], "invalid", "[low, high]"),
    ("/parameters/k/normal/1", -1, "invalid", "at least 0"),
    ("/parameters/k/values", [], "invalid", "at least one value"),
    ("/parameters/k/values/0", "2*kk", "invalid", "unknown name 'kk'"),
    ("/initial_state/thta", {"normal": [0, 1]}, "invalid", "did you mean 'theta'"),
    ("/actuator/U", {"lag": 1}, "invalid", "unknown control 'U'"),
    ("/actuator/T/lga", 1, "invalid", "did you mean 'lag'"),
    ("/actuator/T/lag", -1, "invalid", "at least 0"),
    ("/actuator/T", 3, "invalid", "an object"),
    ("/command/period", 0, "invalid", "greater than 0"),
]


def placed(pointer: str, value: Any) -> dict[str, Any]:
    """A request that has this value at this place."""
    *way, last = pointer.split("/")[1:]
    if last in ("0", "1"):
        last, value = way.pop(), [0, value] if last == "1" else [value]
    asked: dict[str, Any] = {}
    node = asked
    for key in way:
        node = node.setdefault(key, {})
    node[last] = value
    return asked


@pytest.mark.parametrize(("pointer", "value", "kind", "words"), BAD)
def test_a_mistake_is_told_at_its_place(pointer: str, value: Any, kind: str, words: str) -> None:
    found = faults(placed(pointer, value))
    assert list(found) == [pointer]
    assert found[pointer][0] == kind
    assert words in found[pointer][1]


def test_all_mistakes_are_told_at_once() -> None:
    asked = {"runs": 0, "use": "command", "parameters": {"K": {}, "k": {"normal": [1, -1]}}}
    assert faults(asked).keys() == {"/runs", "/use", "/parameters/K", "/parameters/k/normal/1"}
    assert faults([1]) == {"": ("invalid", "flights are asked for by an object, not by a list")}
    assert faults({"coast": float("nan")})["/coast"][0] == "invalid"


def test_a_table_needs_to_be_said() -> None:
    assert (
        check_flights({"use": "command", "command": {"period": 1}}, FLEXIBLE_SPACECRAFT).command is not None
    )
    answered = {**FLEXIBLE_SPACECRAFT, "output": {"command": {"period": 0.5}}}
    spec = check_flights({"use": "command"}, answered)
    assert spec.command is None


@pytest.mark.parametrize("case", ["pse", "edt_dipole"])
def test_missions_in_segments_are_not_flown_so(case: str) -> None:
    assert faults({}, load_case(case))[""][0] == "unsupported"


def test_models_that_look_into_tables_are_not_flown_so() -> None:
    document = load_case("edt_dipole")
    document["method"] = {"name": "gpm"}
    assert "computes by tables" in faults({}, document)[""][1]


def test_what_a_data_table_is_made_of_is_the_same_for_all_flights() -> None:
    answered = copy.deepcopy(FLEXIBLE_SPACECRAFT)
    table = {"x": [0, 1], "values": [0, "2*k"], "interpolation": "linear", "outside": "hold"}
    answered["problem"]["data"] = {"stiff": table}
    found = faults({"parameters": {"k": {"values": [1]}, "m": {"values": [1]}}}, answered)
    assert found == {"/parameters/k": ("unsupported", "unsupported: the data table 'stiff' is made of it")}


def test_the_schema_describes_what_is_read() -> None:
    schema = flights_schema()
    assert schema["properties"]["runs"] == {
        "default": 1000,
        "description": "How many flights.",
        "anyOf": [
            {"type": "integer", "minimum": 1, "maximum": 10_000},
            {"type": "string", "maxLength": 4096},
        ],
        "title": "Runs",
    }
    assert set(schema["properties"]) >= set(GOOD)
