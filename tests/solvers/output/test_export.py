"""What other programs read from the exported files is the trajectory of the result."""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from solvers.output.export import to_csv, to_mat, to_npz, trajectory_csv
from solvers.output.plot import render
from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory


@pytest.fixture
def result(rigid_body: dict[str, Any]) -> dict[str, Any]:
    rigid_body["problem"]["units"] = {"x": "m", "t": "s"}
    return solve(check_document(rigid_body)).result()


def test_csv_has_every_digit(result: dict[str, Any]) -> None:
    header, *rows = csv.reader(io.StringIO(to_csv(result)))
    assert header == ["t", "x", "x_dot", "u"]
    columns = np.array(rows, dtype=float).T
    trajectory = result["trajectory"]
    assert columns[0].tolist() == trajectory["t"]
    assert columns[1].tolist() == trajectory["states"]["x"]
    assert columns[3].tolist() == trajectory["controls"]["u"]


def test_csv_of_a_sample_with_rates(result: dict[str, Any]) -> None:
    sampled = Trajectory.from_result(result).sample(np.array([0.0, 0.5]), derivatives=True)
    header, *rows = csv.reader(io.StringIO(trajectory_csv(sampled)))
    assert header == ["t", "x", "x_dot", "u", "x_rate", "x_dot_rate"]
    assert float(rows[1][4]) == pytest.approx(float(rows[1][2]), abs=1e-12)


def test_npz_loads_without_pickle(result: dict[str, Any]) -> None:
    with np.load(io.BytesIO(to_npz(result)), allow_pickle=False) as arrays:
        assert sorted(arrays) == ["t", "u", "x", "x_dot"]
        assert arrays["x"].tolist() == result["trajectory"]["states"]["x"]


def test_mat_holds_structures(result: dict[str, Any]) -> None:
    content = loadmat(io.BytesIO(to_mat(result)), simplify_cells=True)
    assert content["states"]["x_dot"].tolist() == result["trajectory"]["states"]["x_dot"]
    assert content["controls"]["u"].tolist() == result["trajectory"]["controls"]["u"]
    assert content["objective"] == result["objective"]


def test_svg_is_well_formed_whatever_the_title_is(result: dict[str, Any]) -> None:
    title = "<script>alert(1)</script> --> $x_{ & \x00\x1b]]>"
    tree = ET.fromstring(render(result, "svg", title))
    assert tree.tag.endswith("svg")
    assert not [element for element in tree.iter() if element.tag.endswith("script")]


def test_the_same_result_gives_the_same_svg(result: dict[str, Any]) -> None:
    assert render(result, "svg", "a") == render(result, "svg", "a")
    assert render(result, "svg") == render(result, "svg")


def test_png(result: dict[str, Any]) -> None:
    assert render(result, "png").startswith(b"\x89PNG\r\n")
