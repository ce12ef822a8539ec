"""Arcs that follow a limit of a state or a path constraint, and points that touch one."""

from __future__ import annotations

import copy
import time
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from solvers.bases.graded import GradedKnots
from solvers.catalogue import load_case
from solvers.formulation.stated import stated_problem
from solvers.limits import limits_of
from solvers.optimizers.outcome import Limits
from solvers.progress import SilentProgress
from solvers.refine.search import LOOKS, Search
from solvers.refine.structure import Structure
from solvers.session import Session
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document
from solvers.start.scaling import automatic_scaling
from solvers.transcription.limit_rates import limit_rates
from solvers.transcription.spline_wavelet import SplineWavelet

METHODS = ["swcm", "gpm", "hermite_simpson"]

# From rest to rest over 3 m in least time, with abs(u) <= 1.
CART: dict[str, Any] = {
    "problem": {
        "model": {
            "kind": "mechanical",
            "coordinates": ["x"],
            "controls": ["u"],
            "mass": [[1]],
            "input": [[1]],
        },
        "final_time": [0.1, 20],
        "initial_state": {"x": 0, "x_dot": 0},
        "final_state": {"x": 3, "x_dot": 0},
        "bounds": {"u": [-1, 1]},
        "objective": {"terminal": "tf"},
    }
}


def refined(document: dict[str, Any], method: str) -> Solution:
    solution = solve(check_document({**document, "method": {"name": method, "refine": "switching"}}))
    assert solution.success, solution.message
    assert solution.method["refine"] == "switching"
    return solution


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("limit", "objective", "arcs"),
    [(1 / 9, 4.0, 3), (1 / 6, 8 / 3, None), (0.2, 2.24, 2), (0.3, 2.0, 1)],
    ids=["followed", "touched and about to be followed", "touched", "out of reach"],
)
def test_a_limit_of_second_order(method: str, limit: float, objective: float, arcs: int | None) -> None:
    """Bryson and Denham: J = 4 / (9 l) up to l = 1/6, then 2 + 6 (1 - 4 l)^2 up to 1/4, then 2."""
    document = load_case("bryson_denham")
    document["problem"]["model"]["parameters"]["l"] = limit
    solution = refined(document, method)
    assert solution.objective == pytest.approx(objective, abs=1e-8)
    assert arcs is None or solution.method["arcs"] == arcs
    assert solution.verification.max_bound_violation <= 1e-9


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "limit",
    [
        {"bounds": {"u": [-1, 1], "x_dot": [None, 1]}},
        {"path_constraints": [{"expression": "x_dot^2", "bounds": [None, 1]}]},
    ],
    ids=["state bound", "path constraint"],
)
def test_a_speed_limit_is_of_first_order(method: str, limit: dict[str, Any]) -> None:
    """1 s up to speed, 2 s at the limit, 1 s down."""
    document = copy.deepcopy(CART)
    document["problem"] |= limit
    solution = refined(document, method)
    assert solution.objective == pytest.approx(4.0, abs=1e-10)
    assert solution.switching["u"]["times"] == pytest.approx([1.0, 3.0], abs=1e-8)
    assert solution.switching["u"]["arcs"] == ["upper", "interior", "lower"]
    at_speed = solution.trajectory.controls_at(np.array([0.3, 0.5, 0.7]))
    np.testing.assert_allclose(at_speed, 0.0, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_limit_on_state_and_control_decides_the_control_at_once(method: str) -> None:
    """u + v <= 1.5: full thrust to v = 1/2, then v = 1.5 - exp(-s) for a while S, then full brake."""
    document = copy.deepcopy(CART)
    document["problem"]["path_constraints"] = [{"expression": "u + x_dot", "bounds": [None, 1.5]}]

    def excess(s: float) -> float:
        speed = 1.5 - np.exp(-s)
        return float(0.125 + 1.5 * s - (1.0 - np.exp(-s)) + 0.5 * speed**2 - 3.0)

    follow = brentq(excess, 0.0, 5.0, xtol=1e-14)
    wanted = 0.5 + follow + 1.5 - np.exp(-follow)
    solution = refined(document, method)
    assert solution.objective == pytest.approx(wanted, abs=1e-8)
    assert solution.switching["u"]["times"] == pytest.approx([0.5, 0.5 + follow], abs=1e-4)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("bounds", [[-1.2, 1.2], [None, 1.2]], ids=["two bounds", "one bound"])
def test_a_control_that_comes_to_rest_on_its_bound(method: str, bounds: list[float | None]) -> None:
    """x'' = u from rest to rest over 1 in 2 s with least u^2: a line in time, cut off at the bound."""
    document = copy.deepcopy(CART)
    document["problem"] |= {
        "final_time": 2,
        "final_state": {"x": 1, "x_dot": 0},
        "bounds": {"u": bounds},
        "objective": {"running": "u^2/2"},
    }
    solution = refined(document, method)
    if bounds[0] is None:
        # Rests for 1/4, then straight down by 4.8 / 1.75 to the end.
        wanted = 0.5 * (1.44 * 0.25 + _square_of_line(1.2, 1.2 - 4.8 / 1.75, 1.75))
    else:
        # Rests until s with (1 - s)^2 = 1/2 on both sides.
        rest = 1.0 - np.sqrt(0.5)
        wanted = 0.5 * (2 * 1.44 * rest + _square_of_line(1.2, -1.2, 2.0 - 2.0 * rest))
    assert solution.objective == pytest.approx(wanted, abs=1e-9)


def _square_of_line(start: float, stop: float, length: float) -> float:
    """The integral of the square of a line."""
    return length * (start**2 + start * stop + stop**2) / 3.0


def test_pins_that_keep_a_state_on_its_limit_leave_its_multipliers_alone() -> None:
    """Goddard's rocket coasts at its dry mass, which is a bound: the costates are those without the bound."""
    document = load_case("goddard")
    with_bound = refined(document, "swcm")
    document["problem"]["bounds"]["m"] = [0.5, 1]
    without = refined(document, "swcm")
    coast = with_bound.trajectory.nodes > 0.5
    assert without.method == with_bound.method
    np.testing.assert_allclose(with_bound.costates[:, coast], without.costates[:, coast], atol=1e-6)


def test_a_limit_is_left_where_its_multiplier_has_the_wrong_sign() -> None:
    """Along v <= 1/2, with v' = u, |u| <= 1, the cost -(cos(2 pi t) + 1/2) v pays for a dip in the middle.

    It begins at a: down by u = -1 until 1/2, up again until 1 - a, with sin(2 pi a) / pi = 1/2 - a, for there
    the integral of the weight over the dip is zero. The search is told that the limit is followed throughout.
    """
    document: dict[str, Any] = {
        "problem": {
            "model": {
                "kind": "first_order",
                "states": ["v"],
                "controls": ["u"],
                "dynamics": {"v": "u"},
            },
            "final_time": 1,
            "initial_state": {"v": 0.5},
            "bounds": {"u": [-1, 1], "v": [None, 0.5]},
            "objective": {"running": "-(cos(2*pi*t) + 0.5)*v"},
        }
    }
    problem = stated_problem(check_document(document).problem)
    limits = Limits(time.monotonic() + 60.0, SilentProgress().cancelled)
    session = Session(
        problem=problem,
        scaling=automatic_scaling(problem),
        tolerance=1e-12,
        max_iterations=500,
        limits=limits,
        progress=SilentProgress(),
    )
    knots = GradedKnots.uniform(8, 2)
    start = session.solve_parts(
        [SplineWavelet(problem, session.scaling, problem.guess, knots)], "start"
    ).trajectory
    (limit,) = limits_of(problem)
    rates = limit_rates(problem, limit)
    assert rates is not None
    along = np.array([True])
    structure = Structure(np.array([0.0, 1.0]), {"u": np.array([np.nan])}, {limit: along}, {}, {limit: rates})
    search = Search(session, [start], looks=LOOKS)
    assert search.run([structure]) == "done"
    assert search.best is not None
    (best,) = search.best.parts
    a = brentq(lambda a: np.sin(2 * np.pi * a) / np.pi - 0.5 + a, 0.1, 0.4, xtol=1e-15)
    np.testing.assert_allclose(best.structure.edges, [0, a, 0.5, 1 - a, 1], atol=1e-8)
    np.testing.assert_array_equal(best.structure.pinned["u"], [np.nan, -1, 1, np.nan])
    assert best.wrong_sign <= 1e-6


@pytest.mark.parametrize("clock", ["t", "s"])
def test_a_limit_is_touched_at_its_extreme_where_another_one_decides(clock: str) -> None:
    """u <= 1 - t lets y' = u rise to its peak at t = 1, which y <= 3/8 must not pass; u would rather be 2.

    u = c before t = 1 - c, then 1 - t; the peak c - c^2/2 gives c = 1/2, and the cost is 1/2 9/8 + 63/16.
    With a state s for the time the Hamiltonian is constant, without one it is not.
    """
    document: dict[str, Any] = {
        "problem": {
            "model": {
                "kind": "first_order",
                "states": ["y", "s"],
                "controls": ["u"],
                "dynamics": {"y": "u", "s": "1"},
            },
            "final_time": 2,
            "initial_state": {"y": 0, "s": 0},
            "bounds": {"y": [None, 0.375]},
            "path_constraints": [{"name": "room", "expression": f"u + {clock}", "bounds": [None, 1]}],
            "objective": {"running": "(u - 2)^2/2"},
        }
    }
    solution = refined(document, "swcm")
    assert solution.objective == pytest.approx(4.5, abs=1e-10)
    assert solution.trajectory.controls_at(np.array([0.125]))[0, 0] == pytest.approx(0.5, abs=1e-8)
    assert (solution.verification.hamiltonian_drift is None) == (clock == "t")
