"""The partial space elevator against two point masses on tensioned lines, in inertial axes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from solvers.backends import NUMPY
from solvers.piecewise.equations import Equations
from solvers.space.earth import GRAVITY
from solvers.spec import LibraryReference

Vector = NDArray[np.float64]
START = np.array([0.05, 2e-4, -0.1, -3e-4, 12_000.0, -20.0, 300.0, 2.0])
TENSIONS = (40.0, 55.0)


def elevator(name: str) -> Equations:
    return Equations.of(LibraryReference.model_construct(kind="library", name=name, parameters={}))


def fly(rate: Any, x: Vector, seconds: float) -> Vector:
    flight = solve_ivp(rate, (0, seconds), x, method="DOP853", rtol=1e-12, atol=1e-12)
    return np.asarray(flight.y[:, -1])


def model_flight(name: str, seconds: float) -> Vector:
    model = elevator(name)
    return fly(lambda t, x: np.array(model.rate(x, TENSIONS, t, NUMPY), np.float64), START, seconds)


def turning_axes(angle: float) -> Vector:
    """Forward and up at a true anomaly, by rows."""
    return np.array([[-np.sin(angle), np.cos(angle)], [np.cos(angle), np.sin(angle)]])


def masses_flight(seconds: float) -> Vector:
    """The states of the model from two masses under inverse-square gravity and the pull of the lines."""
    p = elevator("pse_exact").parameters
    om, r, m1, m2 = (p[name] for name in ("om", "r", "m1", "m2"))

    def below(th: float, th_rate: float, length: float, rate: float) -> tuple[Vector, Vector]:
        """A line from its top: vector and rate in inertial axes at anomaly 0."""
        axes = turning_axes(0.0)
        along = -np.array([np.sin(th), np.cos(th)]) @ axes
        across = -np.array([np.cos(th), -np.sin(th)]) @ axes
        return length * along, rate * along + length * (th_rate + om) * across

    def main(t: float) -> tuple[Vector, Vector]:
        forward, up = turning_axes(om * t)
        return r * up, r * om * forward

    th1, th1_rate, th2, th2_rate, l1, l1_rate, lc, lc_rate = START
    first = below(th1, th1_rate, l1, l1_rate)
    second = below(th2, th2_rate, p["L0"] + lc - l1, lc_rate - l1_rate)
    place, speed = main(0.0)
    start = np.concatenate([place + first[0], place + first[0] + second[0]])
    start = np.concatenate([start, speed + first[1], speed + first[1] + second[1]])

    def rate(t: float, y: Vector) -> Vector:
        climber, body = y[:2], y[2:4]
        upper, lower = main(t)[0] - climber, body - climber
        pulls = [
            line / np.linalg.norm(line) * tension
            for line, tension in zip((upper, lower), TENSIONS, strict=True)
        ]
        gravity = [-GRAVITY * place / np.linalg.norm(place) ** 3 for place in (climber, body)]
        return np.concatenate([y[4:], gravity[0] + (pulls[0] + pulls[1]) / m1, gravity[1] - pulls[1] / m2])

    end = fly(rate, start, seconds)
    axes, (place, speed) = turning_axes(om * seconds), main(seconds)
    lines = (end[:2] - place, end[4:6] - speed), (end[2:4] - end[:2], end[6:] - end[4:6])
    states = []
    for line, line_rate in lines:
        forward, up = axes @ line
        length, th = np.hypot(forward, up), np.arctan2(-forward, -up)
        along = line / length
        across = -np.array([np.cos(th), -np.sin(th)]) @ axes
        states += [th, line_rate @ across / length - om, length, line_rate @ along]
    a, a_rate, l1, l1_rate, b, b_rate, l2, l2_rate = states
    return np.array([a, a_rate, b, b_rate, l1, l1_rate, l1 + l2 - p["L0"], l1_rate + l2_rate])


def test_exact_form_is_two_masses_on_lines() -> None:
    ours, theirs = model_flight("pse_exact", 400.0), masses_flight(400.0)
    tolerance = np.array([1e-9, 1e-11, 1e-9, 1e-11, 1e-5, 1e-7, 1e-5, 1e-7])
    np.testing.assert_array_less(np.abs(ours - theirs), tolerance)


def test_linear_gravity_is_off_by_the_length_over_the_radius() -> None:
    seconds = 400.0
    off = np.abs(model_flight("pse", seconds) - model_flight("pse_exact", seconds))
    length, radius = 20_000.0, 7.1e6
    own = 3 * elevator("pse").parameters["om"] ** 2 * length * seconds**2 / 2
    assert 0 < off[4] < 3 * length / radius * own
    assert off[0] < 1e-3


def test_small_angles_are_only_good_for_small_ones() -> None:
    exact = elevator("pse")
    small = elevator("pse_small_angle")
    for angle, close in ((1e-3, True), (0.3, False)):
        x = [angle, 0, -angle, 0, 12_000.0, -20.0, 0, 0]
        rates = [np.array(model.rate(x, TENSIONS, 0.0, NUMPY), np.float64) for model in (exact, small)]
        assert np.allclose(*rates, rtol=1e-4, atol=1e-9) == close


@pytest.mark.parametrize("name", ["pse", "pse_exact"])
def test_the_tensions_do_the_work(name: str) -> None:
    """The Jacobi integral changes by -T1 dL1 - T2 dL2."""
    model = elevator(name)
    p = model.parameters
    om, r, m1, m2 = (p[key] for key in ("om", "r", "m1", "m2"))

    def jacobi(x: Vector) -> float:
        th1, w1, th2, w2, l1, v1, lc, vc = x
        l2, v2 = p["L0"] + lc - l1, vc - v1
        axes = [np.array([[np.sin(th), np.cos(th)], [np.cos(th), -np.sin(th)]]) for th in (th1, th2)]
        place1 = -l1 * axes[0][0]
        place2 = place1 - l2 * axes[1][0]
        speed1 = -v1 * axes[0][0] - l1 * w1 * axes[0][1]
        speed2 = speed1 - v2 * axes[1][0] - l2 * w2 * axes[1][1]
        total = 0.0
        for mass, place, speed in ((m1, place1, speed1), (m2, place2, speed2)):
            forward, up = place
            if name == "pse":
                potential = -1.5 * om**2 * up**2
            else:
                distance = np.hypot(forward, r + up)
                # Less that of the main satellite, to keep the digits.
                potential = GRAVITY * (1 / r - 1 / distance) - om**2 / 2 * (distance**2 - r**2)
            total += mass * (speed @ speed / 2 + potential)
        return float(total)

    end = model_flight(name, 300.0)
    l2 = [p["L0"] + x[6] - x[4] for x in (START, end)]
    work = -TENSIONS[0] * (end[4] - START[4]) - TENSIONS[1] * (l2[1] - l2[0])
    assert jacobi(end) - jacobi(START) == pytest.approx(work, abs=1e-6 if name == "pse" else 2e-5)
    assert abs(work) > 1e4
