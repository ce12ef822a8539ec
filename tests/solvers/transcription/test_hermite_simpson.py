"""Controls of Hermite-Simpson between the nodes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from solvers.formulation.stated import stated_problem
from solvers.optimizers.outcome import Limits
from solvers.progress import SilentProgress
from solvers.session import Session
from solvers.solved import Solved
from solvers.spec import check_document
from solvers.start.scaling import automatic_scaling
from solvers.transcription.hermite_simpson import HermiteSimpson


def solved(document: dict[str, Any], *, within: bool) -> Solved:
    """A document on seven intervals."""
    problem = stated_problem(check_document(document).problem)
    session = Session(
        problem=problem,
        scaling=automatic_scaling(problem),
        tolerance=1e-10,
        max_iterations=200,
        limits=Limits(math.inf, lambda: False),
        progress=SilentProgress(),
    )
    knots = np.linspace(0.0, 1.0, 8)
    mesh = HermiteSimpson(problem, session.scaling, problem.guess, knots, within=within)
    return session.solve_parts([mesh], "solve")


def test_a_control_within_its_bounds_is_so_between_the_nodes(rigid_body: dict[str, Any]) -> None:
    rigid_body["problem"]["bounds"]["u"] = [-3, 1]
    shortest = math.sqrt(8 / 3)  # the switch is at three quarters of it, in the sixth interval
    plain, within = (solved(rigid_body, within=within) for within in (False, True))
    lowest = [item.trajectory.controls_at(np.linspace(0.0, 1.0, 7001)).min() for item in (plain, within)]
    assert lowest[0] < -3.1
    assert lowest[1] >= -3.0 - 1e-9
    # Nothing within the bounds is faster; a slope in the place of the switch costs the square of the step.
    assert shortest <= within.objective <= shortest * (1 + 1 / 49)


def test_what_bounds_do_not_touch_is_the_same(regulator: dict[str, Any]) -> None:
    plain, within = (solved(regulator, within=within) for within in (False, True))
    assert within.objective == pytest.approx(plain.objective, abs=1e-12)
    tau = np.linspace(0.0, 1.0, 101)
    np.testing.assert_allclose(
        within.trajectory.controls_at(tau), plain.trajectory.controls_at(tau), atol=1e-8
    )
