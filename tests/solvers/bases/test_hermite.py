"""Hermite-Simpson constants and pieces against polynomials by hand."""

import numpy as np
import pytest

from solvers.bases.hermite import (
    MIDPOINT_SLOPES,
    MIDPOINT_VALUES,
    SIMPSON,
    cubic_pieces,
    quadratic_pieces,
)

KNOTS = np.array([2.0, 2.5, 4.0, 4.25])


def cubic(t):
    return 1 - 2 * t + 0.5 * t**2 + 0.3 * t**3


def slope(t):
    return -2 + t + 0.9 * t**2


def test_middle_value_is_exact_for_cubics():
    left, right = 2.0, 3.5
    h = right - left
    values = MIDPOINT_VALUES[0] * cubic(left) + MIDPOINT_VALUES[1] * cubic(right)
    slopes = MIDPOINT_SLOPES[0] * slope(left) + MIDPOINT_SLOPES[1] * slope(right)
    assert values + h * slopes == pytest.approx(cubic(2.75), rel=1e-14)


def test_simpson_is_exact_for_cubics_and_not_for_quartics():
    points = np.array([0.0, 0.5, 1.0])
    moments = [np.dot(SIMPSON, points**power) for power in range(5)]
    np.testing.assert_allclose(moments[:4], [1, 1 / 2, 1 / 3, 1 / 4], atol=1e-15)
    assert moments[4] == pytest.approx(5 / 24)


def test_cubic_pieces_reproduce_cubics_and_their_slopes():
    pieces = cubic_pieces(KNOTS, cubic(KNOTS), slope(KNOTS))
    t = np.linspace(2, 4.25, 50)
    np.testing.assert_allclose(pieces(t), cubic(t), rtol=1e-13)
    np.testing.assert_allclose(pieces(t, 1), slope(t), rtol=1e-12, atol=1e-12)


def test_cubic_pieces_of_several_states_meet_values_and_slopes():
    values, slopes = np.random.default_rng(0).normal(size=(2, 4, 3))
    pieces = cubic_pieces(KNOTS, values, slopes)
    np.testing.assert_allclose(pieces(KNOTS), values, atol=1e-14)
    np.testing.assert_allclose(pieces(KNOTS, 1), slopes, atol=1e-13)
    middle = (KNOTS[0] + KNOTS[1]) / 2
    expected = MIDPOINT_VALUES @ values[:2] + 0.5 * (MIDPOINT_SLOPES @ slopes[:2])
    np.testing.assert_allclose(pieces(middle), expected, atol=1e-14)


def test_quadratic_pieces_reproduce_parabolas():
    middles = (KNOTS[:-1] + KNOTS[1:]) / 2
    places = np.stack([KNOTS[:-1], middles, KNOTS[1:]], axis=1)
    pieces = quadratic_pieces(KNOTS, 3 - places + 2 * places**2)
    t = np.linspace(2, 4.25, 50)
    np.testing.assert_allclose(pieces(t), 3 - t + 2 * t**2, rtol=1e-13)
    np.testing.assert_allclose(pieces.derivative()(t), -1 + 4 * t, rtol=1e-12)


def test_quadratic_pieces_of_several_controls_may_jump_at_knots():
    values = np.random.default_rng(1).normal(size=(3, 3, 2))
    pieces = quadratic_pieces(KNOTS, values)
    middles = (KNOTS[:-1] + KNOTS[1:]) / 2
    np.testing.assert_allclose(pieces(KNOTS[:-1]), values[:, 0], atol=1e-14)
    np.testing.assert_allclose(pieces(middles), values[:, 1], atol=1e-14)
    np.testing.assert_allclose(pieces(KNOTS[1:] - 1e-12), values[:, 2], atol=1e-10)
    lengths = np.diff(KNOTS)[:, None]
    by_simpson = np.sum(lengths * np.einsum("k,nkm->nm", SIMPSON, values), axis=0)
    np.testing.assert_allclose(pieces.integrate(2.0, 4.25), by_simpson, atol=1e-14)


@pytest.mark.parametrize(
    ("knots", "shape", "message"),
    [
        ([0.0, 1.0, 1.0], (2, 3), "ascend"),
        ([0.0], (0, 3), "ascend"),
        ([0.0, 1.0, 2.0], (3, 2), r"\(2, 3\)"),
        ([0.0, 1.0, 2.0], (6,), r"\(2, 3\)"),
    ],
)
def test_misshapen_arguments_are_refused(knots, shape, message):
    with pytest.raises(ValueError, match=message):
        quadratic_pieces(knots, np.zeros(shape))
