"""Arcs and switches read off controls whose structure is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.curves import LinearCurve
from solvers.formulation.stated import stated_problem
from solvers.spec import check_document
from solvers.switching import find_switching
from solvers.trajectory import Trajectory


def found(document: dict[str, Any], tau: np.ndarray, values: np.ndarray) -> dict[str, Any]:
    problem = stated_problem(check_document(document).problem)
    control = LinearCurve(tau, values)
    return find_switching(problem, Trajectory(1.0, 3.0, {}, {"u": control}, "linear", {}, tau, tau))


def test_a_switch_between_two_nodes_lies_where_the_control_crosses_the_middle(
    rigid_body: dict[str, Any],
) -> None:
    tau = np.linspace(0, 1, 11)
    values = np.where(tau < 0.55, 1.0, -1.0)
    values[6] = -0.5  # one node in between: crosses zero at 2/3 of the way from node 5 to node 6
    switching = found(rigid_body, tau, values)["u"]
    assert switching["arcs"] == ["upper", "lower"]
    assert switching["levels"] == [1.0, -1.0]
    assert switching["times"] == pytest.approx([1.0 + 2.0 * (0.5 + 0.1 * 2 / 3)])


def test_an_interior_arc_has_no_level(rigid_body: dict[str, Any]) -> None:
    tau = np.linspace(0, 1, 31)
    values = np.interp(tau, [0, 0.3, 0.301, 0.7, 0.701, 1], [1, 1, 0.4, 0.2, -1, -1])
    switching = found(rigid_body, tau, values)["u"]
    assert switching["arcs"] == ["upper", "interior", "lower"]
    assert switching["levels"] == [1.0, None, -1.0]
    assert switching["times"] == pytest.approx([1.6, 2.4], abs=0.1)


@pytest.mark.parametrize(("level", "arc"), [(1.0, "upper"), (-1.0, "lower"), (0.3, "interior")])
def test_a_single_arc_has_no_switch(rigid_body: dict[str, Any], level: float, arc: str) -> None:
    switching = found(rigid_body, np.linspace(0, 1, 9), np.full(9, level))["u"]
    assert switching["arcs"] == [arc]
    assert switching["times"] == []


def test_a_control_without_two_bounds_has_no_entry(rigid_body: dict[str, Any]) -> None:
    rigid_body["problem"]["bounds"] = {"u": [None, 1]}
    assert found(rigid_body, np.linspace(0, 1, 9), np.ones(9)) == {}
