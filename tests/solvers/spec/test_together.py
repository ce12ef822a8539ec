"""Many mistakes at once: all are reported, none hides another, and none is invented."""

from __future__ import annotations

import copy
import time
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solvers.errors import DocumentError
from solvers.spec import JobSpec, check_document, parse_document
from tests.bad_documents import BAD_DOCUMENTS, BadDocument
from tests.solvers.spec.editing import FIRST_ORDER, FLEXIBLE_SPACECRAFT, LIBRARY, REMOVED, edited, faults_of

MODEL = "/problem/model"


def test_mistakes_of_every_kind_are_reported_together() -> None:
    changes: dict[str, Any] = {
        "/schema": 3,
        "/nmae": "x",
        "/tags": ["x" * 65],
        "/webhook": {"url": "x"},
        f"{MODEL}/parameters/m": "1/0",
        f"{MODEL}/parameters/theta_dot": 1,
        f"{MODEL}/mass/0/0": "Jc + Jd",
        f"{MODEL}/damping/1": [0],
        f"{MODEL}/definitions": {"c": "c"},
        "/problem/initial_state/alpha": REMOVED,
        "/problem/initial_state/beta": 0,
        "/problem/final_state/theta": [2, 1],
        "/problem/bounds/T": [5, -5],
        "/problem/bounds/alpha": [1, 2],
        "/problem/final_time": [-2, -1],
        "/problem/objective": {"terminal": "tff", "running": "sin("},
        "/problem/guess/states": {"theta": [0, "oops"]},
        "/method": {"name": "swcm", "L": 2, "J": 99, "refine": "switchng"},
        "/options/max_seconds": 1e9,
        "/output/samples": 0,
    }
    found = [(fault.pointer, fault.type) for fault in faults_of(edited(changes))]
    assert sorted(found) == sorted(
        [
            ("/schema", "invalid"),
            ("/nmae", "invalid"),
            ("/tags/0", "limit"),
            ("/webhook/url", "invalid"),
            (f"{MODEL}/parameters/m", "invalid"),
            (f"{MODEL}/parameters/theta_dot", "invalid"),
            (f"{MODEL}/mass/0/0", "invalid"),
            (f"{MODEL}/mass/0/0", "invalid"),
            (f"{MODEL}/damping/1", "invalid"),
            (f"{MODEL}/definitions/c", "invalid"),
            ("/problem/initial_state", "invalid"),
            ("/problem/initial_state/beta", "invalid"),
            ("/problem/final_state/theta", "invalid"),
            ("/problem/bounds/T", "invalid"),
            ("/problem/final_state/alpha", "invalid"),
            ("/problem/final_time", "invalid"),
            ("/problem/objective/terminal", "invalid"),
            ("/problem/objective/running", "invalid"),
            ("/problem/guess/states/theta/1", "invalid"),
            ("/method/L", "invalid"),
            ("/method/J", "limit"),
            ("/method/refine", "invalid"),
            ("/options/max_seconds", "limit"),
            ("/output/samples", "invalid"),
        ]
    )


@pytest.mark.parametrize(
    "changes",
    [
        {f"{MODEL}/kind": "quantum"},
        {f"{MODEL}/coordinates": REMOVED},
        {f"{MODEL}/coordinates": 3},
        {f"{MODEL}/controls": REMOVED},
        {f"{MODEL}/controls": [3]},
        {f"{MODEL}/coordinates": [f"q{i}" for i in range(100)]},
    ],
)
def test_an_unreadable_model_does_not_make_all_names_unknown(changes: dict[str, Any]) -> None:
    assert len(faults_of(edited(changes))) == 1


def test_a_parameter_without_value_does_not_spoil_what_uses_it() -> None:
    faults = faults_of(edited({f"{MODEL}/parameters/Jb": "oops", "/problem/bounds/T": ["-Jb", "Jb"]}))
    assert [fault.pointer for fault in faults] == [f"{MODEL}/parameters/Jb"]


def test_at_most_a_thousand_faults_and_twenty_suggestions() -> None:
    entries = [["Jc"] * 64] * 64
    faults = faults_of(edited({f"{MODEL}/mass": entries, f"{MODEL}/damping": entries}))
    assert len(faults) == 1000
    assert sum("did you mean" in fault.detail for fault in faults) == 20


def test_nothing_long_is_echoed() -> None:
    long = "x" * 100_000
    changes = {f"/{long}": 1, f"/problem/bounds/{long}": 1, f"{MODEL}/mass/0/0": "m*" + "x" * 3000}
    faults = faults_of(edited(changes))
    assert len(faults) == 3
    assert all(len(fault.pointer) < 400 and len(fault.detail) < 400 for fault in faults)


@pytest.mark.parametrize("bad", BAD_DOCUMENTS, ids=lambda bad: bad.name)
def test_the_shared_table_of_bad_documents(bad: BadDocument) -> None:
    start = time.process_time()
    with pytest.raises(DocumentError) as caught:
        check_document(parse_document(bad.raw))
    assert time.process_time() - start < 0.5
    if bad.pointer is not None:
        assert (bad.pointer, bad.type) in {(fault.pointer, fault.type) for fault in caught.value.faults}


def chain_of_masses(n: int) -> dict[str, Any]:
    """Return a document of ``n`` masses in a row, joined by cubic springs, with full matrices."""
    q = [f"q{i}" for i in range(n)]
    band = {0: "k1 + k2 + c*({0}^2 + {1}^2)", 1: "-k2 - c*{0}*{1}", -1: "-k1 - c*{0}*{1}"}
    stiffness = [
        [band[j - i].format(q[i], q[j]) if abs(i - j) < 2 else 0 for j in range(n)] for i in range(n)
    ]
    damping = [["d*(1 + abs(" + q[i] + "_dot))" if i == j else 0 for j in range(n)] for i in range(n)]
    model = {
        "kind": "mechanical",
        "coordinates": q,
        "controls": ["u"],
        "parameters": {"m": 1, "k1": 2, "k2": "k1/2", "c": 0.1, "d": 0.01},
        "mass": [["m" if i == j else 0 for j in range(n)] for i in range(n)],
        "damping": damping,
        "stiffness": stiffness,
        "input": [[1 if i == 0 else 0] for i in range(n)],
    }
    problem = {
        "model": model,
        "final_time": [1, 100],
        "initial_state": {"*": 0},
        "final_state": dict.fromkeys(q, "10*deg") | {f"{x}_dot": 0 for x in q},
        "bounds": {"u": ["-5*m", "5*m"]} | {x: [-10, 10] for x in q},
        "path_constraints": [{"expression": f"({a} - {b})^2", "bounds": [None, 4]} for a, b in pairwise(q)],
        "objective": {"terminal": "tf", "running": "0.01*u^2"},
    }
    return {
        "name": "chain",
        "tags": ["speed"],
        "problem": problem,
        "method": {"name": "swcm", "L": 8, "J": 4},
    }


# Values that are wrong, or odd, in most places of a document.
odd = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(10**30), 10**30),
    st.floats(),
    st.text(max_size=5),
    st.sampled_from(["theta", "T", "alpha_dot", "2*k", "*", "tf", "swcm", "mechanical", "1/0", "sin("]),
    st.lists(st.one_of(st.none(), st.integers(-3, 3), st.text(max_size=2)), max_size=3),
    st.dictionaries(st.text(max_size=3), st.integers(-3, 3), max_size=2),
)


def places(value: Any, way: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [
        *((way,) if way else ()),
        *(place for key, child in items for place in places(child, (*way, key))),
    ]


@settings(max_examples=500, deadline=None)
@given(data=st.data(), base=st.sampled_from([FLEXIBLE_SPACECRAFT, FIRST_ORDER, LIBRARY]))
def test_any_change_is_accepted_or_refused_with_pointers(data: st.DataObject, base: dict[str, Any]) -> None:
    document = copy.deepcopy(base)
    for _ in range(data.draw(st.integers(1, 3))):
        *way, last = data.draw(st.sampled_from(places(document)))
        place: Any = document
        for step in way:
            place = place[step]
        action = data.draw(st.sampled_from(["set", "remove", "add"]))
        if action == "set":
            place[last] = data.draw(odd)
        elif action == "remove":
            del place[last]
        elif isinstance(place, dict):
            place[data.draw(st.text(max_size=4))] = data.draw(odd)
        if not document:
            break
    result: JobSpec | None = None
    faults = ()
    try:
        result = check_document(document)
    except DocumentError as error:
        faults = error.faults
    if result is None:
        assert faults
        for fault in faults:
            assert points_into(document, fault.pointer)
            assert fault.detail
            assert (fault.pointer + fault.detail).encode()
    else:
        assert result.resolved().sha256
        assert result.problem.model.parameter_values().keys() == dict(result.problem.model.parameters).keys()


def points_into(document: Any, pointer: str) -> bool:
    """Tell whether a pointer leads to a place of the document, or to a key that is missing there."""
    assert pointer == "" or pointer.startswith("/")
    place = document
    parts = [part.replace("~1", "/").replace("~0", "~") for part in pointer.split("/")[1:]]
    for depth, part in enumerate(parts):
        if isinstance(place, list):
            place = place[int(part)]
        elif isinstance(place, dict):
            keys = {str(key).encode("utf-8", "backslashreplace").decode(): key for key in place}
            if part not in keys:
                return depth == len(parts) - 1
            place = place[keys[part]]
        else:
            return False
    return True
