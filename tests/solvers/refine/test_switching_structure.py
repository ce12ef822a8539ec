"""Structures: how they are read off an answer, joined, cut, and written down."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.curves import LinearCurve
from solvers.formulation.stated import stated_problem
from solvers.limits import Limit, limits_of
from solvers.problem import OptimalControlProblem
from solvers.refine.detection import active_stretches, find_structure
from solvers.refine.mesh import ArcMesh, first_mesh
from solvers.refine.structure import Pieces, Structure
from solvers.spec import check_document
from solvers.switching import control_arcs
from solvers.trajectory import Trajectory
from solvers.transcription.limit_rates import limit_rates

NAN = np.nan


@pytest.fixture
def problem(rigid_body: dict[str, Any]) -> OptimalControlProblem:
    rigid_body["problem"]["bounds"] = {"u": [-1, 1], "x": [None, 1], "x_dot": [-2, 0.5]}
    return stated_problem(check_document(rigid_body).problem)


def trajectory(tau: np.ndarray, x: np.ndarray, v: np.ndarray, u: np.ndarray) -> Trajectory:
    states = {"x": LinearCurve(tau, x), "x_dot": LinearCurve(tau, v)}
    return Trajectory(0.0, 2.0, states, {"u": LinearCurve(tau, u)}, "linear", {}, tau, tau)


def no_costates() -> np.ndarray:
    raise AssertionError("nobody should have asked")


def speed_limit(problem: OptimalControlProblem) -> Limit:
    (limit,) = [item for item in limits_of(problem) if item.pointer.endswith("/x_dot") and item.upper]
    return limit


def test_limits_and_their_orders(problem: OptimalControlProblem) -> None:
    found = {(item.pointer, item.upper): item for item in limits_of(problem)}
    assert set(found) == {
        ("/problem/bounds/x", True),
        ("/problem/bounds/x_dot", True),
        ("/problem/bounds/x_dot", False),
    }
    position = limit_rates(problem, found["/problem/bounds/x", True])
    speed = limit_rates(problem, found["/problem/bounds/x_dot", True])
    assert position is not None
    assert speed is not None
    assert (position.order, speed.order) == (2, 1)
    assert position.controls == (0,)
    at = np.array([[3.0], [4.0]]), np.array([[0.25]]), np.array([0.0])
    np.testing.assert_allclose(position.along(problem.parameters, *at)[:, 0], [3.0, 4.0, 0.25])


def test_a_limit_that_no_control_moves_has_no_order(regulator: dict[str, Any]) -> None:
    regulator["problem"]["path_constraints"] = [{"expression": "t", "bounds": [None, 5]}]
    problem = stated_problem(check_document(regulator).problem)
    (limit,) = limits_of(problem)
    assert limit_rates(problem, limit) is None


def test_bang_speed_limit_bang(problem: OptimalControlProblem) -> None:
    tau = np.linspace(0, 1, 41)
    v = np.interp(tau, [0, 0.25, 0.75, 1], [0, 0.5, 0.5, 0])
    u = np.select([tau < 0.24, tau > 0.76], [1.0, -1.0], 0.0)
    structure = find_structure(problem, trajectory(tau, tau / 2, v, u), lambda: np.zeros((2, 41)))
    limit = speed_limit(problem)
    followed = structure.followed[limit]
    assert structure.pinned["u"][0] == 1.0
    assert structure.pinned["u"][-1] == -1.0
    assert np.isnan(structure.pinned["u"][1:-1]).all()
    start, stop = np.flatnonzero(followed)[[0, -1]]
    # It begins and ends where the control leaves its bounds, midway between two samples.
    np.testing.assert_allclose(structure.edges[[start, stop + 1]], [0.2375, 0.7625])
    assert structure.arcs == 3


def test_a_single_sample_on_a_limit_is_a_touch_and_an_end_condition_is_none(
    problem: OptimalControlProblem,
) -> None:
    tau = np.linspace(0, 1, 41)
    v = 0.5 - 2.0 * (tau - 0.5) ** 2
    limit = speed_limit(problem)
    touch = active_stretches(problem, trajectory(tau, tau, v, tau), limit)
    np.testing.assert_allclose(touch, [[0.5, 0.5]])
    ending = active_stretches(problem, trajectory(tau, tau, tau / 2, tau), limit)
    assert ending.size == 0


def test_chatter_between_a_bound_and_the_inside_is_an_interior_arc() -> None:
    values = np.array([1, 1, 1, 1, 0.2, 0.3, 1, 0.2, 0.3, 1, 1, 0.2, 0.1, 0.3, -1, -1, -1, -1], float)
    strength = np.array([1, 0.8, 0.5, 0.3] + [1e-4] * 10 + [0.3, 0.5, 0.8, 1])
    with_strength = control_arcs(values, (-1.0, 1.0), strength)
    assert [(arc.kind, arc.nodes) for arc in with_strength] == [("upper", 4), ("interior", 10), ("lower", 4)]
    assert [arc.kind for arc in control_arcs(values, (-1.0, 1.0))] == ["upper", "lower"]
    # Where the switching function is not small, the visits are arcs of their own.
    assert [arc.kind for arc in control_arcs(values, (-1.0, 1.0), np.ones(18))] == ["upper", "lower"]


def test_arcs_that_vanish_are_dropped_and_what_is_alike_is_joined() -> None:
    structure = Structure(np.array([0, 0.3, 0.3, 0.6, 0.6 + 1e-7, 1.0]), {"u": np.array([1, NAN, -1, 1, -1])})
    reduced = structure.without_empty_arcs()
    np.testing.assert_allclose(reduced.edges, [0, 0.3, 1])
    np.testing.assert_array_equal(reduced.pinned["u"], [1, -1])


def test_a_limit_that_is_followed_for_no_time_is_touched(problem: OptimalControlProblem) -> None:
    limit = speed_limit(problem)
    rates = limit_rates(problem, limit)
    assert rates is not None
    structure = Structure(
        np.array([0, 0.5, 0.5, 1.0]),
        {"u": np.full(3, NAN)},
        {limit: np.array([False, True, False])},
        rates={limit: rates},
    )
    reduced = structure.without_empty_arcs()
    np.testing.assert_allclose(reduced.edges, [0, 0.5, 1])
    assert not reduced.followed
    assert reduced.touched[limit].tolist() == [False, True]
    assert reduced.pattern != structure.pattern


def test_cuts_of_several_controls_are_made_together(problem: OptimalControlProblem) -> None:
    structure = Structure(np.array([0, 0.5, 1.0]), {"a": np.array([1.0, 0.0]), "b": np.array([0.0, 0.0])})
    cut = structure.changed(
        problem,
        {
            "a": [
                Pieces(np.array([0.4]), np.array([1.0, 0.0])),
                Pieces(np.array([0.6]), np.array([1.0, 0.0])),
            ],
            "b": [None, Pieces(np.array([0.6]), np.array([0.0, 1.0]))],
        },
    )
    np.testing.assert_allclose(cut.edges, [0, 0.4, 0.5, 0.6, 1])
    np.testing.assert_array_equal(cut.pinned["a"], [1, 0, 1, 0])
    np.testing.assert_array_equal(cut.pinned["b"], [0, 0, 0, 1])


def test_patterns_tell_levels_apart_but_not_instants() -> None:
    first = Structure(np.array([0, 0.3, 1.0]), {"u": np.array([1.0, NAN])})
    assert first.pattern == Structure(np.array([0, 0.7, 1.0]), {"u": np.array([1.0, NAN])}).pattern
    assert first.pattern != Structure(np.array([0, 0.3, 1.0]), {"u": np.array([NAN, 1.0])}).pattern


def test_no_costates_are_asked_for_where_every_control_rests_on_a_bound(
    problem: OptimalControlProblem,
) -> None:
    tau = np.linspace(0, 1, 21)
    found = find_structure(
        problem, trajectory(tau, 0 * tau, 0 * tau, np.where(tau < 0.49, 1.0, -1.0)), no_costates
    )
    assert found.pinned["u"].tolist() == [1.0, -1.0]


def test_the_first_mesh_follows_the_fastest_motion(oscillator: dict[str, Any]) -> None:
    """x'' + x = u over T: more nodes for a longer arc, then more segments."""
    oscillator["problem"]["bounds"] = {"u": [-1, 1]}
    problem = stated_problem(check_document(oscillator).problem)
    tau = np.linspace(0, 1, 3)

    def nodes(duration: float) -> ArcMesh:
        curve = LinearCurve(tau, tau)
        start = Trajectory(0.0, duration, {"x": curve, "x_dot": curve}, {"u": curve}, "linear", {}, tau, tau)
        structure = Structure(np.array([0.0, 0.1, 1.0]), {"u": np.array([1.0, -1.0])})
        return first_mesh(problem, start, structure)

    short, medium, long = (nodes(duration) for duration in (0.5, 8.0, 80.0))
    assert short.counts == ((8,), (8,))
    assert len(medium.counts[1]) == 1
    assert medium.counts[1][0] > medium.counts[0][0]
    assert len(long.counts[1]) > 1
    assert long.parts[1][-1] == 1.0
    breaks = long.breaks(np.array([0.0, 0.1, 1.0]))
    assert breaks.size == len(long.flat_counts) + 1
    assert 0.1 in breaks
