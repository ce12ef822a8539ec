"""Data tables of a document: what is taken, and what is said of the rest."""

from __future__ import annotations

from typing import Any

import pytest

from solvers.errors import DocumentError
from solvers.spec import check_document
from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.solvers.spec.editing import FIRST_ORDER, edited

TABLE = {"x": [0, "pi", 4], "values": [0, "2*k", -1]}


def faults(changes: dict[str, Any], base: dict[str, Any] = FLEXIBLE_SPACECRAFT) -> dict[str, tuple[str, str]]:
    with pytest.raises(DocumentError) as refusal:
        check_document(edited(changes, base))
    return {fault.pointer: (fault.type, fault.detail) for fault in refusal.value.faults}


def test_a_table_has_its_numbers_from_the_parameters_and_its_defaults() -> None:
    changes = {"/problem/data": {"Td": TABLE}, "/problem/model/force": ["Td(t)", "Td(theta - 1)"]}
    spec = check_document(edited(changes))
    table = spec.problem.tables()["Td"]
    assert (table.interpolation, table.outside) == ("cubic", "hold")
    assert table.values == (0.0, 200.0, -1.0)
    assert table.names == {"k"}
    resolved = spec.resolved()
    assert resolved.document["problem"]["data"]["Td"]["interpolation"] == "cubic"
    assert "/problem/data/Td/outside" in resolved.defaults_applied


DATA = "/problem/data"
FORCE = "/problem/model/force"


def table(**changes: Any) -> dict[str, Any]:
    return {DATA: {"Td": {**TABLE, **changes}}}


ROWS: list[tuple[dict[str, Any], str, str]] = [
    (table(x=[0], values=[0]), f"{DATA}/Td/values", "at least 2"),
    (table(x=[0, 1]), f"{DATA}/Td/values", "3 values for 2"),
    (table(x=[0, 1, 1]), f"{DATA}/Td/x/2", "ascends"),
    (table(x=[0, "k/0", 1]), f"{DATA}/Td/x/1", "finite"),
    (table(x=[0, "q", 1]), f"{DATA}/Td/x/1", "unknown name"),
    ({DATA: {"Td": {"values": [0, 1]}}}, f"{DATA}/Td/x", "required"),
    (table(interpolation="spline"), f"{DATA}/Td/interpolation", "one of"),
    (table(outside="zero"), f"{DATA}/Td/outside", "one of"),
    (table(y=1), f"{DATA}/Td/y", "unknown key"),
    ({DATA: {"k": TABLE}}, f"{DATA}/k", "already taken by a parameter"),
    ({DATA: {"sin": TABLE}}, f"{DATA}/sin", "reserved"),
    ({DATA: {"theta_f": TABLE}}, f"{DATA}/theta_f", "generated"),
    ({FORCE: ["Tb(t)", 0], **table()}, f"{FORCE}/0", "unknown function"),
    ({FORCE: ["Td", 0], **table()}, f"{FORCE}/0", "call it"),
    ({FORCE: ["Td(t, 1)", 0], **table()}, f"{FORCE}/0", "if it is a data table, it takes 1 argument"),
    ({FORCE: ["ln(2)", 0]}, f"{FORCE}/0", "did you mean 'log'?"),
    ({FORCE: ["k(t)", 0]}, f"{FORCE}/0", "no data table"),
    ({"/problem/objective/terminal": "Td(tf)", **table()}, "/problem/objective/terminal", "cannot be used"),
    ({"/problem/model/parameters/k": "foo(1)"}, "/problem/model/parameters/k", "unknown function 'foo'"),
    ({"/problem/bounds/T": ["k(1)", 5]}, "/problem/bounds/T/0", "no data table"),
]


@pytest.mark.parametrize(
    ("changes", "pointer", "word"), [pytest.param(*row, id=f"{row[1]}-{row[2]}") for row in ROWS]
)
def test_mistake(changes: dict[str, Any], pointer: str, word: str) -> None:
    kind, detail = faults(changes)[pointer]
    assert kind == "invalid"
    assert word in detail


def test_limits() -> None:
    long = {"x": list(range(2001)), "values": [0] * 2001}
    assert faults({"/problem/data": {"Td": long}})["/problem/data/Td/x"][0] == "limit"
    many = {f"T{index}": TABLE for index in range(65)}
    assert faults({"/problem/data": many})["/problem/data"][0] == "limit"


def test_tables_of_a_mission_and_design_of_computed_quantities_are_not_in_this_version() -> None:
    library = {
        "/problem/model": {"kind": "library", "name": "edt"},
        "/problem/initial_state": {"*": 0},
        "/problem/bounds": {},
        "/problem/design": {"L": {"bounds": [1, 2]}},
        "/problem/data": {"Td": TABLE},
        "/method": {"name": "piecewise"},
    }
    found = faults(library, FIRST_ORDER)
    assert found["/problem/design/L"][0] == "unsupported"
    assert "computed quantities" in found["/problem/design/L"][1]
    assert found["/problem/data"] == (
        "unsupported",
        "unsupported: 'data' with the method piecewise is not in this version",
    )
