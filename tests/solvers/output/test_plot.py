"""What a picture shows, read from the drawn figure and from the SVG's own text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pytest

from solvers.output.plot import draw, render
from solvers.solve import solve
from solvers.spec import check_document

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def result(rigid_body: dict[str, Any]) -> dict[str, Any]:
    rigid_body["problem"]["units"] = {"x": "m", "t": "s", "u": "<N>"}
    rigid_body["problem"]["outputs"] = [{"name": "power", "expression": "u*x_dot", "units": "W"}]
    rigid_body["method"] = {"name": "swcm", "refine": "switching"}
    return solve(check_document(rigid_body)).result()


def test_rows_are_labelled_with_units(result: dict[str, Any]) -> None:
    figure = draw(result)
    assert [axis.get_ylabel() for axis in figure.axes] == ["x [m]", "x_dot", "u [<N>]", "power [W]"]
    assert figure.axes[-1].get_xlabel() == "t [s]"
    assert [axis.texts[0].get_text() for axis in figure.axes] == ["state", "state", "control", "output"]


def test_words_are_text_and_escaped(result: dict[str, Any]) -> None:
    tree = ET.fromstring(render(result, "svg", "<script>"))
    words = [element.text for element in tree.iter(f"{SVG}text")]
    assert {"x [m]", "u [<N>]", "power [W]", "t [s]", "<script>"} <= set(words)


def test_switches_and_bounds_are_marked(result: dict[str, Any]) -> None:
    (switch,) = result["switching"]["u"]["times"]
    assert switch == pytest.approx(1.0, abs=1e-9)  # closed form
    position, _, control, _ = draw(result).axes
    vertical = [line for line in control.get_lines() if len(set(line.get_xdata())) == 1]
    assert [line.get_xdata()[0] for line in vertical] == [switch]
    flat = [line.get_ydata()[0] for line in control.get_lines() if list(line.get_xdata()) == [0, 1]]
    assert sorted(flat) == pytest.approx([-1, 1])
    assert [text.get_text() for text in position.texts] == ["state", "1"]


def test_at_a_switch_there_are_its_two_values_and_no_third(result: dict[str, Any]) -> None:
    """One of 201 samples falls on the switching time but for rounding."""
    trajectory = result["trajectory"]
    t, u = np.array(trajectory["t"]), np.array(trajectory["controls"]["u"])
    near = np.abs(t - 1.0) < 1e-6
    np.testing.assert_allclose(u[near], [1, -1], atol=1e-6)
    assert t.size == 202


def test_several_plants_share_a_picture(rigid_body: dict[str, Any]) -> None:
    cases = [{"name": "heavy", "parameters": {"m": 1.1}}]
    rigid_body["problem"]["scenarios"] = {"cases": cases, "nominal": True}
    rigid_body["problem"]["final_state"] = {"x": [0.9, 1.1], "x_dot": [-0.2, 0.2]}
    result = solve(check_document(rigid_body)).result()
    figure = draw(result)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["nominal", "heavy"]
    curves = figure.axes[0].get_lines()[:2]
    for line, plant in zip(curves, ("nominal", "heavy"), strict=True):
        np.testing.assert_array_equal(
            line.get_ydata(), result["scenarios"][plant]["trajectory"]["states"]["x"]
        )
    assert not curves[0].is_dashed()
    assert curves[1].is_dashed()


def test_a_model_of_the_library_brings_its_units() -> None:
    document = {
        "problem": {
            "model": {"kind": "library", "name": "rigid_body"},
            "final_time": [0.5, 10],
            "initial_state": {"*": 0},
            "final_state": {"x": 1, "x_dot": 0},
            "bounds": {"u": [-1, 1]},
            "objective": {"terminal": "tf"},
        },
        "method": {"name": "swcm"},
    }
    figure = draw(solve(check_document(document)).result())
    assert [axis.get_ylabel() for axis in figure.axes] == ["x [m]", "x_dot [m/s]", "u [N]"]
