"""A stop is a boundary constraint: all that can be said of an end, at the first instant where it holds."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from solvers.piecewise.setup import Setup
from solvers.piecewise.stop import StopWatch
from solvers.spec import check_document
from tests.solvers.piecewise.documents import PENDULUM

TIMES = np.linspace(0.0, 3.0, 31)
# angle = 1 - t/2, rate = -1/2, phase = 0.3 + t/2; torque = t.
SEEN = np.array([1.0 - TIMES / 2.0, np.full(TIMES.size, -0.5), 0.3 + TIMES / 2.0])
TORQUE = TIMES[None, :]


def watch(expression: str, bounds: Any, *, average: bool = False) -> StopWatch:
    document = copy.deepcopy(PENDULUM)
    document["problem"]["outputs"] = [{"name": "double", "expression": "2*angle"}]
    stop = {"expression": expression, "bounds": bounds, "average": average}
    document["method"]["stop"] = stop
    setup = Setup.of(check_document(document))
    return StopWatch.of(setup.problem, setup.method)


@pytest.mark.parametrize(
    ("expression", "bounds", "instant"),
    [
        ("phase_f", [1.5, None], 2.4),
        ("phase_f - phase_0", [1.2, None], 2.4),
        ("angle_f", [None, 0], 2.0),
        ("double_f", [None, 0.5], 1.5),
        ("torque_f - torque_0", [1.25, None], 1.25),
        ("tf - t0", ["3*beat", None], 1.5),
        ("torque_f", [None, 1], 0.1),  # at the start too, which ends nothing
        ("phase_f", [2, None], None),
    ],
)
def test_the_first_instant_at_which_it_is_met(expression: str, bounds: Any, instant: float | None) -> None:
    assert watch(expression, bounds).met(TIMES, SEEN, TORQUE) == (
        None if instant is None else pytest.approx(instant, abs=1e-12)
    )


def test_the_start_is_that_of_the_mission() -> None:
    two = watch("phase_f - phase_0", [1.2, None])
    first, second = slice(0, 11), slice(10, 31)
    assert two.met(TIMES[first], SEEN[:, first], TORQUE[:, first]) is None
    assert two.met(TIMES[second], SEEN[:, second], TORQUE[:, second]) == pytest.approx(2.4, abs=1e-12)


def test_averages_go_straight_from_middle_to_middle() -> None:
    mean = watch("torque_f", [1.2, None], average=True)
    first, second = slice(0, 11), slice(10, 31)  # means 0.5 at 0.5 s and 2 at 2 s
    assert mean.met(TIMES[first], SEEN[:, first], TORQUE[:, first]) is None
    assert mean.met(TIMES[second], SEEN[:, second], TORQUE[:, second]) == pytest.approx(1.2, abs=1e-12)
