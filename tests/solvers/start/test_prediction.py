from dataclasses import replace

import numpy as np
import pytest

from solvers.bases.legendre import legendre_gauss
from solvers.curves import LagrangeCurve
from solvers.phases.trajectory import PhasedTrajectory
from solvers.start.prediction import predicted
from solvers.trajectory import Trajectory

SUPPORT = legendre_gauss(4)[0]


def answer(p: float, switch: float | None = None, segments: int = 2) -> Trajectory:
    """An answer that is a parabola in ``p``: everything moves with it, the switch too."""
    switch = 0.4 + 0.1 * p - 0.05 * p**2 if switch is None else switch
    breaks = np.array([0.0, switch, 1.0]) if segments == 2 else np.array([0.0, 0.2, switch, 1.0])
    supports = (SUPPORT,) * segments
    slopes = [(1.0 + p + p**2) * (index + SUPPORT) for index in range(segments)]
    levels = [np.full(SUPPORT.size, 5.0 * (-1.0) ** index) for index in range(segments)]
    return Trajectory(
        t0=0.0,
        tf=3.0 - p + 2.0 * p**2,
        states={"x": LagrangeCurve(breaks, supports, tuple(slopes))},
        controls={"u": LagrangeCurve(breaks, supports, tuple(levels))},
        interpolation="polynomial",
        basis={},
        breakpoints=breaks,
        nodes=breaks,
        design={"m": p**2},
    )


def test_three_answers_predict_what_is_a_parabola() -> None:
    places = [0.4, 0.2, 0.1]
    found, truth = predicted(places, [answer(p) for p in places], 0.55), answer(0.55)
    assert found is not None
    assert (found.t0, found.tf, found.design["m"]) == pytest.approx((0.0, truth.tf, 0.55**2), abs=1e-12)
    assert found.breakpoints == pytest.approx(truth.breakpoints, abs=1e-13)
    tau = np.linspace(0.0, 1.0, 77)
    for curve, true in ((found.states["x"], truth.states["x"]), (found.controls["u"], truth.controls["u"])):
        assert curve(tau) == pytest.approx(true(tau), abs=1e-11)


def test_phases_are_predicted_one_by_one() -> None:
    """And when they meet, which moves as a parabola too."""

    def flight(p: float, *names: str) -> PhasedTrajectory:
        first, second = answer(p), replace(answer(p), t0=3.0 - p + 2.0 * p**2, tf=9.0 + p**2)
        return PhasedTrajectory((first, second), names)

    places = [0.4, 0.2, 0.1]
    found = predicted(places, [flight(p, "a", "b") for p in places], 0.55)
    assert isinstance(found, PhasedTrajectory)
    assert found.names == ("a", "b")
    assert found.edges == pytest.approx([0.0, 3.0 - 0.55 + 2.0 * 0.55**2, 9.0 + 0.55**2], abs=1e-12)
    assert found.parts[1].states["x"](SUPPORT) == pytest.approx(answer(0.55).states["x"](SUPPORT), abs=1e-11)
    others = [flight(p, *names) for p, names in ((0.2, ("a", "b")), (0.1, ("b", "a")))]
    assert predicted([0.2, 0.1], others, 0.3) is None
    assert predicted([0.2, 0.1], [others[0], answer(0.1)], 0.3) is None


def test_what_is_not_alike_or_far_predicts_nothing() -> None:
    near, beside = answer(0.2), answer(0.1)
    assert predicted([0.2, 0.1], [near, beside], 0.3) is not None
    assert predicted([0.2, 0.1], [near, answer(0.1, segments=3)], 0.3) is None
    assert predicted([0.2, 0.1], [near, beside], 3.0) is None
    # The switch would leave the flight.
    assert predicted([0.2, 0.1], [answer(0.2, switch=0.1), answer(0.1, switch=0.5)], 0.3) is None
