"""The document with its defaults written out: complete, the same for equal documents, and accepted again."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import pytest

from solvers.spec import canonical_json, check_document, parse_document
from tests.solvers.spec.editing import FIRST_ORDER, FLEXIBLE_SPACECRAFT, LIBRARY, edited


def test_defaults_are_written_out_and_named() -> None:
    resolution = check_document(FIRST_ORDER).resolved()
    document = resolution.document
    assert document["schema"] == 1
    assert document["method"] == {"name": "auto", "accuracy": 1e-6}
    assert document["problem"]["initial_time"] == 0
    assert document["options"] == {
        "tolerance": 1e-8,
        "max_iterations": 3000,
        "max_seconds": 60.0,
        "starts": 1,
        "verification": {"terminal_error": 1e-6, "state_error": 1e-6, "bound": 1e-6, "path": 1e-6},
    }
    assert document["output"] == {"samples": 201}
    assert set(resolution.defaults_applied) == {
        "/schema",
        "/problem/initial_time",
        "/method/name",
        "/method/accuracy",
        "/options/tolerance",
        "/options/max_iterations",
        "/options/max_seconds",
        "/options/starts",
        "/options/verification/terminal_error",
        "/options/verification/state_error",
        "/options/verification/bound",
        "/options/verification/path",
        "/output/samples",
        "/priority",
    }


def test_what_was_submitted_stays_as_it_was() -> None:
    submitted = edited({"/problem/initial_state/alpha": None, "/problem/bounds/alpha": [None, "k"]})
    document = check_document(submitted).resolved().document
    assert document["problem"]["initial_state"] == submitted["problem"]["initial_state"]
    assert document["problem"]["bounds"] == {"T": [-5, 5], "alpha": [None, "k"]}
    assert document["problem"]["model"] == submitted["problem"]["model"]
    assert "/method/L" not in check_document(submitted).resolved().defaults_applied


def test_library_parameters_are_written_out() -> None:
    resolution = check_document(edited({"/problem/model/parameters": {"k": 50}}, LIBRARY)).resolved()
    assert resolution.document["problem"]["model"] == {
        "kind": "library",
        "name": "flexible_spacecraft",
        "parameters": {"Jb": 440.0, "R": 2.5, "m": 10.0, "L": 5.0, "k": 50},
    }
    assert "/problem/model/parameters/Jb" in resolution.defaults_applied
    assert "/problem/model/parameters/k" not in resolution.defaults_applied


@pytest.mark.parametrize("document", [FLEXIBLE_SPACECRAFT, FIRST_ORDER, LIBRARY])
def test_a_resolved_document_is_accepted_and_resolves_to_itself(document: dict[str, Any]) -> None:
    first = check_document(document).resolved()
    again = check_document(parse_document(json.dumps(first.document))).resolved()
    assert again.document == first.document
    assert again.sha256 == first.sha256
    assert again.defaults_applied == ()


def test_the_fingerprint_is_that_of_the_canonical_text() -> None:
    resolution = check_document(FLEXIBLE_SPACECRAFT).resolved()
    text = canonical_json(resolution.document)
    assert resolution.sha256 == hashlib.sha256(text.encode()).hexdigest()
    assert json.loads(text) == resolution.document


@pytest.mark.parametrize(
    "changes",
    [
        {"/problem/model/parameters/Jb": 440.0},
        {"/problem/path_constraints": [], "/problem/model/definitions": {}},
        {"/options/starts": 1},
        {"/method/L": "3.2*R", "/method/J": "0.4*m", "/output/samples": "200 + 1"},
        {"/reference": {"objective": 25.9}, "/$schema": "x"},
        {"/problem/initial_state": dict(reversed(FLEXIBLE_SPACECRAFT["problem"]["initial_state"].items()))},
    ],
)
def test_equal_documents_have_equal_fingerprints(changes: dict[str, Any]) -> None:
    wanted = check_document(FLEXIBLE_SPACECRAFT).resolved().sha256
    assert check_document(edited(changes)).resolved().sha256 == wanted


@pytest.mark.parametrize(
    "changes",
    [
        {"/problem/model/parameters/Jb": 440.1},
        {"/method/J": 5},
        {"/options/verification": {"bound": 1e-3}},
        {"/problem/model/stiffness/1/1": "2 * k"},
        {"/name": "other"},
    ],
)
def test_other_documents_have_other_fingerprints(changes: dict[str, Any]) -> None:
    wanted = check_document(FLEXIBLE_SPACECRAFT).resolved().sha256
    assert check_document(edited(changes)).resolved().sha256 != wanted
