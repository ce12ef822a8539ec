"""What is no modal model, and where the document is told so."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from solvers.spec import check_document
from tests.solvers.spec.editing import REMOVED, edited, faults_of

MODEL = "/problem/model"
DOCUMENT: dict[str, Any] = {
    "problem": {
        "model": {
            "kind": "modal",
            "axes": ["theta"],
            "inertia": [[1565]],
            "controls": ["T"],
            "input": [[1]],
            "parameters": {"f1": 0.1, "delta": 33.54},
            "modes": [{"name": "p1", "frequency_hz": "f1", "damping": 0.005, "coupling": ["delta"]}],
            "mode_basis": "constrained",
        },
        "final_time": [1, 100],
        "initial_state": {"*": 0},
        "final_state": {"theta": 1},
        "objective": {"terminal": "tf + vibration_energy_f"},
    }
}
MODE = f"{MODEL}/modes/0"
FAULTS: list[tuple[dict[str, Any], str, str]] = [
    ({f"{MODEL}/mode_basis": REMOVED}, f"{MODEL}/mode_basis", "is required"),
    ({f"{MODEL}/mode_basis": "fixed"}, f"{MODEL}/mode_basis", "'constrained' or 'free'"),
    ({f"{MODEL}/axes": []}, f"{MODEL}/axes", "at least 1 axis"),
    ({f"{MODEL}/axis": 1}, f"{MODEL}/axis", "did you mean 'axes'"),
    ({f"{MODEL}/inertia": [[1, 2]]}, f"{MODEL}/inertia/0", "one for each axis, 1 in all"),
    ({f"{MODEL}/inertia": [[0]]}, f"{MODEL}/inertia", "positive definite"),
    ({f"{MODEL}/inertia": [["theta"]]}, f"{MODEL}/inertia/0/0", "'theta' cannot be used here"),
    ({f"{MODEL}/inertia": [[1124]]}, f"{MODE}/coupling", "not physical"),
    ({f"{MODEL}/parameters/delta": 40}, f"{MODE}/coupling", "not physical"),
    ({f"{MODE}/coupling": [1, 2]}, f"{MODE}/coupling", "one for each axis, 1 in all, not 2"),
    ({f"{MODE}/coupling": REMOVED}, f"{MODE}/coupling", "is required"),
    ({f"{MODE}/frequency_hz": 0}, f"{MODE}/frequency_hz", "greater than 0"),
    ({f"{MODE}/frequency_hz": "f2"}, f"{MODE}/frequency_hz", "did you mean 'f1'"),
    ({f"{MODE}/frequency": 1}, f"{MODE}/frequency", "did you mean 'frequency_hz'"),
    ({f"{MODE}/damping": -0.1}, f"{MODE}/damping", "at least 0"),
    ({f"{MODE}/name": "theta"}, f"{MODE}/name", "already taken by an axis"),
    ({f"{MODEL}/parameters/vibration_energy": 1}, f"{MODEL}/parameters/vibration_energy", "generated"),
    ({f"{MODEL}/input": [[1], [1]]}, f"{MODEL}/input", "one for each axis, 1 in all, not 2"),
]


@pytest.mark.parametrize(("changes", "pointer", "word"), FAULTS)
def test_faults(changes: dict[str, Any], pointer: str, word: str) -> None:
    faults = faults_of(edited(changes, DOCUMENT))
    assert [fault.pointer for fault in faults] == [pointer], faults
    assert word in faults[0].detail


def test_an_inertia_matrix_is_symmetric() -> None:
    changes: dict[str, Any] = {
        f"{MODEL}/axes": ["theta", "phi"],
        f"{MODEL}/inertia": [[2000, 1], [0, 2000]],
        f"{MODEL}/input": [[1], [0]],
        f"{MODE}/coupling": [1, 2],
    }
    assert [fault.pointer for fault in faults_of(edited(changes, DOCUMENT))] == [f"{MODEL}/inertia"]
    changes[f"{MODEL}/inertia"] = {"diag": [2000, 3]}
    assert [fault.pointer for fault in faults_of(edited(changes, DOCUMENT))] == [f"{MODE}/coupling"]


def test_what_it_stands_for() -> None:
    spec = check_document(copy.deepcopy(DOCUMENT))
    model = spec.problem.model
    assert model.states == ("theta", "p1", "theta_dot", "p1_dot")
    assert spec.resolved().document["problem"]["model"]["kind"] == "modal"
    assert check_document(spec.resolved().document).problem.model == model


def test_more_modes_than_states_are_refused() -> None:
    modes = [{"name": f"p{k}", "frequency_hz": 1, "coupling": [0]} for k in range(32)]
    faults = faults_of(edited({f"{MODEL}/modes": modes}, DOCUMENT))
    assert [(fault.pointer, fault.type) for fault in faults] == [(f"{MODEL}/modes", "limit")]
