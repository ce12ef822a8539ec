"""Compiled structures are reused where only numbers differ, and never where anything else does."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from solvers.bases.graded import GradedKnots
from solvers.cache import STRUCTURES, StructureCache
from solvers.formulation.stated import stated_problem
from solvers.optimizers.outcome import Limits
from solvers.progress import SilentProgress
from solvers.session import Session
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document
from solvers.start.scaling import automatic_scaling
from solvers.transcription.base import Transcription
from solvers.transcription.gauss_pseudospectral import GaussPseudospectral
from solvers.transcription.hermite_simpson import HermiteSimpson
from solvers.transcription.spline_wavelet import SplineWavelet

METHODS = ["swcm", "gpm", "hermite_simpson"]


@pytest.fixture(autouse=True)
def _empty_cache() -> Iterator[None]:
    forget()
    yield
    forget()


def forget() -> None:
    STRUCTURES.clear()


def answer(
    document: dict[str, Any], method: str = "swcm", level: int = 2, **options: Any
) -> tuple[float, int]:
    """Objective and iterations of one mesh, without verification."""
    problem = stated_problem(check_document(document).problem)
    scaling = automatic_scaling(problem)
    common = problem, scaling, problem.guess
    transcription: Transcription
    match method:
        case "swcm":
            transcription = SplineWavelet(*common, GradedKnots.uniform(5, level))
        case "gpm":
            transcription = GaussPseudospectral(*common, np.array([0.0, 1.0]), (10,))
        case _:
            transcription = HermiteSimpson(*common, np.linspace(0.0, 1.0, 13))
    settings = {"tolerance": 1e-8, "max_iterations": 500} | options
    limits = Limits(time.monotonic() + 60, lambda: False)
    session = Session(problem=problem, scaling=scaling, **settings, limits=limits, progress=SilentProgress())
    solved = session.solve_parts([transcription], "solve")
    return solved.objective, session.iterations


def numbers(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Problems of one structure: another stiffness, bound, end, guess and final time."""
    changed = [copy.deepcopy(document) for _ in range(5)]
    changed[0]["problem"]["model"]["parameters"]["k"] = 137
    changed[1]["problem"]["bounds"]["T"] = [-4.5, 5.5]
    changed[2]["problem"]["final_state"]["theta"] = 0.6
    changed[3]["problem"]["guess"] = {"final_time": 28}
    changed[4]["problem"]["final_time"] = [1, 60]
    return changed


@pytest.mark.parametrize("method", METHODS)
def test_another_end_of_a_velocity_reuses_the_structure(
    flexible_spacecraft: dict[str, Any], method: str
) -> None:
    slow, fast = copy.deepcopy(flexible_spacecraft), copy.deepcopy(flexible_spacecraft)
    slow["problem"]["initial_state"]["theta_dot"] = 0.0010
    fast["problem"]["initial_state"]["theta_dot"] = 0.0011
    alone = answer(fast, method)
    forget()
    answer(slow, method)
    assert answer(fast, method) == alone
    assert len(STRUCTURES) == 1


Change = Callable[[dict[str, Any]], Any]
STRUCTURAL: list[Change] = [
    lambda p: p["model"]["mass"][1].__setitem__(1, "2*m*L^2 + 1"),
    lambda p: p["model"]["stiffness"][0].__setitem__(0, 1),
    lambda p: p["model"].__setitem__("stiffness", None),
    lambda p: p["bounds"].__setitem__("alpha", [-0.02, 0.02]),
    lambda p: p["bounds"].__setitem__("alpha_dot", [-0.02, 0.02]),
    lambda p: p["final_state"].pop("alpha_dot"),
    lambda p: p["objective"].__setitem__("running", "T^2/100"),
    lambda p: p.__setitem__("path_constraints", [{"expression": "alpha + theta", "bounds": [None, 2]}]),
    lambda p: p.__setitem__("boundary_constraints", [{"expression": "alpha_f^2", "bounds": [None, 2]}]),
]


@pytest.mark.parametrize("method", METHODS)
def test_another_number_reuses_the_structure_and_gives_its_own_answer(
    flexible_spacecraft: dict[str, Any], method: str
) -> None:
    problems = numbers(flexible_spacecraft)
    alone = []
    for problem in problems:
        forget()
        alone.append(answer(problem, method))
    forget()
    answer(flexible_spacecraft, method)
    together = [answer(problem, method) for problem in problems]
    assert len(STRUCTURES) == 1
    assert together == alone
    assert len(set(together[:3])) == 3


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("change", STRUCTURAL)
def test_another_structure_is_never_mixed_up(
    flexible_spacecraft: dict[str, Any], method: str, change: Change
) -> None:
    other = copy.deepcopy(flexible_spacecraft)
    change(other["problem"])
    alone = answer(other, method)
    forget()
    first = answer(flexible_spacecraft, method)
    after = answer(other, method)
    again = answer(flexible_spacecraft, method)
    assert len(STRUCTURES) == 2
    assert after == alone
    assert again == first


def test_options_that_are_compiled_in_are_told_apart(rigid_body: dict[str, Any]) -> None:
    answer(rigid_body)
    answer(rigid_body, tolerance=1e-4)
    answer(rigid_body, max_iterations=2)
    assert len(STRUCTURES) == 3


def test_the_cache_is_bounded(rigid_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    small = StructureCache(most_unknowns=100)
    monkeypatch.setattr("solvers.session.STRUCTURES", small)
    for level in (0, 1, 2, 3):
        answer(rigid_body, level=level)
        assert small.unknowns <= 100
    assert len(small) == 1
    answer(rigid_body, level=5)
    assert len(small) == 0


def test_a_structure_in_use_is_not_handed_out_twice(rigid_body: dict[str, Any]) -> None:
    """A solve that starts another of the same structure from its own progress: each has its own answer."""
    inner: list[Solution] = []

    class Nested:
        def report(self, report: object) -> None:
            if not inner:
                inner.append(solve(check_document(other)))

        def cancelled(self) -> bool:
            return False

    other = copy.deepcopy(rigid_body)
    other["problem"]["final_state"]["x"] = 1.2
    outer = solve(check_document(rigid_body), Nested())
    assert outer.objective == pytest.approx(2.0, abs=1e-3)
    assert inner[0].objective == pytest.approx(2.0 * 1.2**0.5, abs=1e-3)
