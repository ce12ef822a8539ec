"""Sweeps as they are read: their points, the path through them, and every mistake at its place."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

from solvers.errors import DocumentError, Fault
from solvers.spec.pointers import parse_pointer, with_value
from solvers.spec.sweep import MAX_POINTS, check_sweep
from solvers.sweep_path import path_through_grid, path_through_points
from tests.bad_documents import FLEXIBLE_SPACECRAFT

K = "/problem/model/parameters/k"
M = "/problem/model/parameters/m"


def swept(grid: Any, **more: Any) -> dict[str, Any]:
    return {"document": copy.deepcopy(FLEXIBLE_SPACECRAFT), "grid": grid, **more}


def faults(body: Any) -> list[Fault]:
    with pytest.raises(DocumentError) as caught:
        check_sweep(body)
    return list(caught.value.faults)


def test_the_points_are_the_product_with_the_last_pointer_fastest() -> None:
    plan = check_sweep(swept({K: [50, 100], M: [9, 10, "2*5.5"]}))
    assert plan.pointers == (K, M)
    assert [point.values for point in plan.points] == [
        (50, 9),
        (50, 10),
        (50, "2*5.5"),
        (100, 9),
        (100, 10),
        (100, "2*5.5"),
    ]
    last = plan.points[-1]
    assert last.document["problem"]["model"]["parameters"] == {
        **FLEXIBLE_SPACECRAFT["problem"]["model"]["parameters"],
        "k": 100,
        "m": "2*5.5",
    }
    assert last.spec.problem.model.parameter_values()["m"] == 11.0


def test_the_document_that_is_swept_is_left_alone() -> None:
    body = swept({K: [50]})
    check_sweep(body)
    assert body["document"] == FLEXIBLE_SPACECRAFT


def test_zip_takes_the_values_side_by_side() -> None:
    plan = check_sweep(swept({K: [50, 100], M: [9, 10]}, zip=True))
    assert [point.values for point in plan.points] == [(50, 9), (100, 10)]


@pytest.mark.parametrize(
    ("scale", "middle"), [({}, 250.0), ({"scale": "linear"}, 250.0), ({"scale": "log"}, math.sqrt(40_000))]
)
def test_a_range(scale: dict[str, str], middle: float) -> None:
    plan = check_sweep(swept({K: {"from": 100, "to": "2*200", "count": 3, **scale}}))
    assert [point.values[0] for point in plan.points] == pytest.approx([100, middle, 400], rel=1e-14)
    assert [point.place[0] for point in plan.points] == pytest.approx([0, 0.5, 1], abs=1e-14)


def test_a_key_that_is_not_there_yet_is_set() -> None:
    body = swept({"/options/starts": [1, 2]})
    del body["document"]["options"]
    assert [point.spec.options.starts for point in check_sweep(body).points] == [1, 2]


def test_neighbours_on_the_path_through_a_grid_differ_in_one_axis_by_one_value() -> None:
    axes = [np.array([0.0, 1.0, 0.5]), np.array([1.0, 0.0]), np.array([0.0, 0.2, 0.4, 1.0])]
    path = path_through_grid(axes)
    assert sorted(path) == list(range(24))
    ranks = [np.argsort(np.argsort(axis)) for axis in axes]
    places = np.array([[ranks[0][i // 8], ranks[1][i // 4 % 2], ranks[2][i % 4]] for i in path])
    assert np.abs(np.diff(places, axis=0)).sum(axis=1).tolist() == [1] * 23


def test_the_path_through_scattered_points_goes_to_the_nearest() -> None:
    points = np.array([[0.9], [0.1], [0.5], [0.0], [0.4]])
    assert path_through_points(points) == [3, 1, 4, 2, 0]


def test_zipped_values_in_any_order_are_solved_along_a_path() -> None:
    plan = check_sweep(swept({K: [120, 80, 100, 90]}, zip=True))
    assert [plan.points[index].values[0] for index in plan.path] == [80, 90, 100, 120]


def test_a_pointer_with_escapes() -> None:
    assert parse_pointer("/a~1b/m~0n/") == ("a/b", "m~n", "")
    assert with_value({"a/b": [1, {"x": 2}]}, ("a/b", "1", "x"), 3) == {"a/b": [1, {"x": 3}]}


ESCAPED = "/grid/~1problem~1model~1parameters~1k"


@pytest.mark.parametrize(
    ("body", "pointer", "words", "kind"),
    [
        ([], "", "an object, not a list", "invalid"),
        ({"grid": {K: [1]}}, "/document", "is required", "invalid"),
        ({"document": {}}, "/grid", "is required", "invalid"),
        (swept({}), "/grid", "not an empty one", "invalid"),
        (swept([1]), "/grid", "not a list", "invalid"),
        (swept({K: [1]}, zap=True), "/zap", "did you mean 'zip'", "invalid"),
        (swept({K: [1]}, zip=1), "/zip", "true or false", "invalid"),
        (swept({K: []}), ESCAPED, "at least one value", "invalid"),
        (swept({K: 3}), ESCAPED, "must be a list", "invalid"),
        (swept({"k": [1]}), "/grid/k", "starts with '/'", "invalid"),
        (swept({"/a~2": [1]}), "/grid/~1a~02", "'~0'", "invalid"),
        (swept({"/name/x": [1]}), "/grid/~1name~1x", "no place", "invalid"),
        (
            swept({"/problem/model/mass/2/0": [1]}),
            "/grid/~1problem~1model~1mass~12~10",
            "no place",
            "invalid",
        ),
        (swept({K: {"from": 1, "to": 2}}), f"{ESCAPED}/count", "is required", "invalid"),
        (swept({K: {"from": 1, "to": 2, "count": 1.5}}), f"{ESCAPED}/count", "whole number", "invalid"),
        (swept({K: {"from": 1, "two": 2, "count": 2}}), f"{ESCAPED}/two", "'to'", "invalid"),
        (swept({K: {"from": "x", "to": 2, "count": 2}}), f"{ESCAPED}/from", "unknown name 'x'", "invalid"),
        (swept({K: {"from": 0, "to": 2, "count": 2, "scale": "log"}}), ESCAPED, "positive", "invalid"),
        (swept({K: {"from": 1, "to": 2, "count": 2, "scale": "ln"}}), f"{ESCAPED}/scale", "'log'", "invalid"),
        (swept({K: [1], "/problem": [{}]}), ESCAPED, "lies inside '/problem'", "invalid"),
        (swept({K: [1, 2], M: [1]}, zip=True), f"{ESCAPED[:-1]}m", "as many values", "invalid"),
        (swept({K: {"from": 1, "to": 2, "count": MAX_POINTS + 1}}), f"{ESCAPED}/count", "10,000", "limit"),
        (swept({K: list(range(101)), M: list(range(100))}), "/grid", "10,100", "limit"),
        (swept({K: [1, "q", 2]}), f"{ESCAPED}/1", "unknown name 'q'", "invalid"),
        (swept({"/method/J": [4, 99]}), "/grid/~1method~1J/1", "levels", "limit"),
        (swept({"/problem/model/mass": [[[1]]]}), "/grid/~1problem~1model~1mass/0", "misshapen", "invalid"),
    ],
)
def test_a_mistake_is_told_at_its_place(body: Any, pointer: str, words: str, kind: str) -> None:
    found = [fault for fault in faults(body) if fault.pointer == pointer]
    assert found, faults(body)
    assert words in found[0].detail
    assert found[0].type == kind


def test_a_mistake_of_the_document_is_told_once_and_in_the_document() -> None:
    body = swept({K: [1, 2, 3]})
    body["document"]["wrong"] = 1
    assert [(fault.pointer, "wrong" in fault.detail) for fault in faults(body)] == [("/document/wrong", True)]


def test_a_mistake_that_only_some_points_make_names_the_first_of_them() -> None:
    bounds = "/problem/bounds/theta"
    found = faults(swept({bounds: [[-3, 3], [-3, 0.5], [-3, 0.4]]}))
    assert [fault.pointer for fault in found] == ["/document/problem/final_state/theta"] * 2
    assert "at point 1 " in found[0].detail


def test_a_large_sweep() -> None:
    plan = check_sweep(
        swept({K: {"from": 50, "to": 200, "count": 100}, M: {"from": 5, "to": 9, "count": 10}})
    )
    assert len(plan.points) == len(set(plan.path)) == 1000
