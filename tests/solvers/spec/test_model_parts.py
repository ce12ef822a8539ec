"""Matrices in their three forms, definitions, flexible coordinates and outputs: read or refused."""

from __future__ import annotations

from typing import Any

import pytest

from solvers.formulation.dynamics import Dynamics
from solvers.spec import MechanicalModel, check_document
from tests.solvers.spec.editing import FIRST_ORDER, FLEXIBLE_SPACECRAFT, LIBRARY, edited, faults_of

MODEL = "/problem/model"
MASS = FLEXIBLE_SPACECRAFT["problem"]["model"]["mass"]


def model_of(changes: dict[str, Any]) -> MechanicalModel:
    model = check_document(edited(changes)).problem.model
    assert isinstance(model, MechanicalModel)
    return model


@pytest.mark.parametrize(
    ("form", "rows"),
    [
        ({"diag": ["Jb", 1]}, (("Jb", 0), (0, 1))),
        ({"entries": [[0, 0, MASS[0][0]], [0, 1, 2], [1, 1, 3]]}, ((MASS[0][0], 2), (0, 3))),
        ({"entries": [[0, 0, 9], [1, 0, "m"], [1, 1, 30]], "symmetric": True}, ((9, "m"), ("m", 30))),
        ({"entries": [[0, 0, 9], [1.0, 1, 30]], "symmetric": False}, ((9, 0), (0, 30))),
    ],
)
def test_forms_of_a_matrix(form: dict[str, Any], rows: tuple[Any, ...]) -> None:
    model = model_of({f"{MODEL}/mass": form})
    assert model.rows("mass") == rows
    assert check_document(edited({f"{MODEL}/mass": form})).resolved().document["problem"]["model"][
        "mass"
    ] == (form)


def test_entries_of_the_input_matrix() -> None:
    changes = {
        f"{MODEL}/controls": ["T", "F", "N"],
        f"{MODEL}/input": {"entries": [[0, 0, 1], [1, 2, "L"]]},
    }
    assert model_of(changes).rows("input") == ((1, 0, 0), (0, 0, "L"))


def test_both_forms_make_the_same_equations() -> None:
    stiffness = {"entries": [[1, 1, "2*k"]]}
    models = model_of({}), model_of({f"{MODEL}/stiffness": stiffness})
    written, sparse = ([item.text for item in Dynamics.from_model(model).expressions] for model in models)
    assert written == sparse


MATRIX_FAULTS: list[tuple[Any, str, str]] = [
    ({}, "", "either 'diag' or 'entries'"),
    ({"diag": [1, 1], "entries": []}, "", "either 'diag' or 'entries'"),
    ({"dag": [1, 1]}, "/dag", "did you mean 'diag'"),
    ({"diag": [1]}, "/diag", "2 in all, not 1"),
    ({"diag": 3}, "/diag", "must be a list"),
    ({"diag": [1, "Jc"]}, "/diag/1", "unknown name 'Jc'"),
    ({"diag": [1, 1], "symmetric": True}, "/symmetric", "goes with 'entries' only"),
    ({"entries": {}}, "/entries", "must be a list"),
    ({"entries": [[0, 0]]}, "/entries/0", "[row, column, value]"),
    ({"entries": [[0, 2, 1]]}, "/entries/0/1", "not among 0 ... 1"),
    ({"entries": [[-1, 0, 1]]}, "/entries/0/0", "not among 0 ... 1"),
    ({"entries": [[0.5, 0, 1]]}, "/entries/0/0", "whole number"),
    ({"entries": [["0", 0, 1]]}, "/entries/0/0", "whole number"),
    ({"entries": [[0, 0, "sin("]]}, "/entries/0/2", "ends where a value"),
    ({"entries": [[0, 0, 1], [0, 0, 2]]}, "/entries/1", "stands twice"),
    ({"entries": [[0, 1, 1], [1, 0, 2]], "symmetric": True}, "/entries/1", "stands twice"),
    ({"entries": [], "symmetric": 1}, "/symmetric", "true or false"),
    ({"entries": [[1, 1, 1]]}, "", "singular at the start"),
]


@pytest.mark.parametrize(("form", "place", "word"), MATRIX_FAULTS)
def test_faults_of_a_matrix(form: Any, place: str, word: str) -> None:
    faults = faults_of(edited({f"{MODEL}/mass": form}))
    assert (f"{MODEL}/mass{place}", True) in [(fault.pointer, word in fault.detail) for fault in faults]


@pytest.mark.parametrize(
    ("form", "place"),
    [({"diag": [1, 1]}, "/diag"), ({"entries": [[0, 0, 1]], "symmetric": True}, "/symmetric")],
)
def test_an_input_matrix_is_not_square(form: Any, place: str) -> None:
    assert [fault.pointer for fault in faults_of(edited({f"{MODEL}/input": form}))] == [
        f"{MODEL}/input{place}"
    ]


DEFINITION_FAULTS: list[tuple[dict[str, Any], str, str]] = [
    ({f"{MODEL}/definitions": {"a": "2*b", "b": 1}}, f"{MODEL}/definitions/a", "'b' comes later"),
    ({f"{MODEL}/definitions": {"a": "a"}}, f"{MODEL}/definitions/a", "'a' comes later"),
    ({f"{MODEL}/definitions": {"alpha": 1}}, f"{MODEL}/definitions/alpha", "already taken by a coordinate"),
    ({f"{MODEL}/definitions": {"m": 1}}, f"{MODEL}/definitions/m", "already taken by a parameter"),
    ({f"{MODEL}/definitions": {"pi": 1}}, f"{MODEL}/definitions/pi", "is reserved"),
    ({f"{MODEL}/definitions": {"T_dot": 1}}, f"{MODEL}/definitions/T_dot", "generated for 'T'"),
    ({f"{MODEL}/definitions": {"c": "theta_ddot"}}, f"{MODEL}/definitions/c", "cannot be used here"),
    ({f"{MODEL}/definitions": []}, f"{MODEL}/definitions", "must be an object"),
    ({f"{MODEL}/definitions": {"c": 1}, "/problem/bounds/T": [0, "c"]}, "/problem/bounds/T/1", "'c' cannot"),
    (
        {f"{MODEL}/definitions": {"c": 1}, "/problem/objective/terminal": "c"},
        "/problem/objective/terminal",
        "'c' cannot",
    ),
    ({f"{MODEL}/flexible": ["alpa"]}, f"{MODEL}/flexible/0", "did you mean 'alpha'"),
    ({f"{MODEL}/flexible": ["alpha", "alpha"]}, f"{MODEL}/flexible/1", "stands twice"),
    ({f"{MODEL}/flexible": "alpha"}, f"{MODEL}/flexible", "must be a list"),
    (
        {f"{MODEL}/flexible": ["alpha"], f"{MODEL}/parameters/vibration_energy": 1},
        f"{MODEL}/parameters/vibration_energy",
        "generated for 'flexible'",
    ),
]
OUTPUT_FAULTS: list[tuple[Any, str, str]] = [
    ([{"expression": "T"}], "/0/name", "is required"),
    ([{"name": "a"}], "/0/expression", "is required"),
    ([{"name": "alpha", "expression": 1}], "/0/name", "already taken by a coordinate"),
    ([{"name": "a", "expression": 1}, {"name": "a", "expression": 2}], "/1/name", "taken by an output"),
    ([{"name": "a b", "expression": 1}], "/0/name", "is not a name"),
    ([{"name": "a", "expression": "b"}, {"name": "b", "expression": 1}], "/0/expression", "unknown name 'b'"),
    ([{"name": "a", "expression": 1, "unit": "N"}], "/0/unit", "did you mean 'units'"),
    ([{"name": "a", "expression": 1, "units": 3}], "/0/units", "must be text"),
    ([{"name": "a", "expression": "theta_dddot"}], "/0/expression", "unknown name"),
    ([{"name": f"a{i}", "expression": 1} for i in range(201)], "", "at most 200 outputs"),
]


@pytest.mark.parametrize(
    ("changes", "pointer", "word"),
    [
        *DEFINITION_FAULTS,
        *(({"/problem/outputs": v}, f"/problem/outputs{p}", w) for v, p, w in OUTPUT_FAULTS),
    ],
)
def test_faults(changes: dict[str, Any], pointer: str, word: str) -> None:
    faults = faults_of(edited(changes))
    assert [fault.pointer for fault in faults] == [pointer], faults
    assert word in faults[0].detail


def test_accelerations_are_no_names_of_a_first_order_model() -> None:
    changes = {"/problem/outputs": [{"name": "a", "expression": "v_ddot"}]}
    assert [fault.pointer for fault in faults_of(edited(changes, FIRST_ORDER))] == [
        "/problem/outputs/0/expression"
    ]


def test_an_output_may_not_have_a_name_of_a_library_model() -> None:
    changes = {"/problem/outputs": [{"name": "Jb", "expression": "alpha_ddot"}]}
    assert [fault.pointer for fault in faults_of(edited(changes, LIBRARY))] == ["/problem/outputs/0/name"]


def test_definitions_that_grow_beyond_measure_are_refused_at_once() -> None:
    table = {"d0": "alpha"} | {f"d{i}": f"d{i - 1} + d{i - 1}" for i in range(1, 900)}
    faults = faults_of(edited({f"{MODEL}/definitions": table}))
    assert faults[0].pointer == f"{MODEL}/definitions/d17"
    assert faults[0].type == "limit"
    assert "at most 100,000" in faults[0].detail
    assert not faults_of(edited({f"{MODEL}/definitions": dict(list(table.items())[:17])}))
