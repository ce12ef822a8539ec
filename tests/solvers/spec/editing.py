"""How the tests make documents out of the good one."""

from __future__ import annotations

import copy
from typing import Any

from solvers.errors import DocumentError, Fault
from solvers.spec import check_document
from tests.bad_documents import FLEXIBLE_SPACECRAFT as FLEXIBLE_SPACECRAFT

REMOVED = object()
"""As a value: take the key away."""

FIRST_ORDER: dict[str, Any] = {
    "problem": {
        "model": {
            "kind": "first_order",
            "states": ["x", "v"],
            "controls": ["u"],
            "parameters": {"m": 2},
            "dynamics": {"x": "v", "v": "u/m"},
        },
        "final_time": 1,
        "initial_state": {"x": 0, "v": 0},
        "objective": {"running": "u^2"},
    }
}
"""A small document of a first-order model."""

LIBRARY: dict[str, Any] = {
    "problem": {
        "model": {"kind": "library", "name": "flexible_spacecraft"},
        "final_time": [1, 100],
        "initial_state": {"*": 0},
        "final_state": {"theta": "pi/6"},
        "bounds": {"T": [-5, 5]},
        "objective": {"terminal": "tf"},
    }
}
"""A small document of a library model."""


def edited(changes: dict[str, Any], base: dict[str, Any] = FLEXIBLE_SPACECRAFT) -> dict[str, Any]:
    """Return a copy of ``base`` with the values at JSON pointers set, added or removed."""
    document = copy.deepcopy(base)
    for pointer, value in changes.items():
        *way, last = (part.replace("~1", "/").replace("~0", "~") for part in pointer.split("/")[1:])
        place: Any = document
        for step in way:
            place = place[int(step)] if isinstance(place, list) else place.setdefault(step, {})
        if value is REMOVED:
            del place[last]
        else:
            place[int(last) if isinstance(place, list) else last] = value
    return document


def faults_of(document: object) -> tuple[Fault, ...]:
    """Return the faults for which a document is refused, none if it is accepted."""
    try:
        check_document(document)
    except DocumentError as error:
        return error.faults
    return ()
