"""The spline space against closed forms: polynomials, cardinal splines, moments, order of interpolation."""

import numpy as np
import pytest

from solvers.bases.cubic_spline import CubicSplineSpace

GRADED = np.array([0.0, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 1.0])
SPACES = [CubicSplineSpace.uniform(8), CubicSplineSpace.uniform(2), CubicSplineSpace(GRADED)]
RNG = np.random.default_rng(20140331)


def cubic(points: np.ndarray, derivative: int) -> np.ndarray:
    """1 - 2 t + 3 t^2 - 4 t^3 and its derivatives, by hand."""
    t = np.asarray(points)
    return [
        1 - 2 * t + 3 * t**2 - 4 * t**3,
        -2 + 6 * t - 12 * t**2,
        6 - 24 * t,
        np.full_like(t, -24.0),
    ][derivative]


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
def test_cubic_polynomials_are_reproduced_with_all_derivatives(space, derivative):
    coefficients = space.interpolate(cubic(space.interpolation_points, 0))
    points = np.concatenate([space.knots, np.linspace(0, 1, 37)])
    expected = cubic(points, derivative)
    tolerance = 1e-11 * 16.0**derivative
    np.testing.assert_allclose(space.matrix(points, derivative) @ coefficients, expected, atol=tolerance)
    np.testing.assert_allclose(space.evaluate(coefficients, points, derivative), expected, atol=tolerance)


def test_values_and_derivatives_of_the_cardinal_spline_at_the_knots():
    space = CubicSplineSpace.uniform(8)
    row = 4
    expected = {
        0: [1 / 6, 2 / 3, 1 / 6],
        1: [-8 / 2, 0.0, 8 / 2],
        2: [64.0, -128.0, 64.0],
    }
    for derivative, entries in expected.items():
        matrix = space.matrix(space.knots, derivative).toarray()
        np.testing.assert_allclose(matrix[row, row : row + 3], entries, atol=1e-12)
        assert np.diff(space.matrix(space.knots, derivative).indptr).max() <= 3


@pytest.mark.parametrize("space", SPACES)
def test_values_are_a_partition_of_unity_and_derivatives_sum_to_zero(space):
    points = RNG.uniform(size=40)
    np.testing.assert_allclose(space.matrix(points).sum(axis=1), 1.0, atol=1e-14)
    for derivative in (1, 2, 3):
        np.testing.assert_allclose(space.matrix(points, derivative).sum(axis=1), 0.0, atol=1e-9)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("derivative", [1, 2, 3])
def test_matrices_agree_with_difference_quotients(space, derivative):
    """Central differences of the next lower derivative, taken inside one interval."""
    middles = (space.knots[:-1] + space.knots[1:]) / 2
    step = np.diff(space.knots).min() / 8
    higher = space.matrix(middles, derivative).toarray()
    lower = [space.matrix(middles + sign * step, derivative - 1).toarray() for sign in (1, -1)]
    tolerance = {1: 4.0 * step**2 * np.abs(space.matrix(middles, 3).toarray()).max(), 2: 1e-9, 3: 1e-9}
    np.testing.assert_allclose((lower[0] - lower[1]) / (2 * step), higher, atol=tolerance[derivative])


def test_third_derivative_at_knots_is_the_limit_from_the_right_but_at_one():
    space = CubicSplineSpace(GRADED)
    inside = GRADED[:-1] + 1e-6
    at_knots = space.matrix(GRADED, 3).toarray()
    np.testing.assert_array_equal(at_knots[:-1], space.matrix(inside, 3).toarray())
    np.testing.assert_array_equal(at_knots[-1], at_knots[-2])


def test_greville_points_of_second_first_and_third_derivative():
    space = CubicSplineSpace(GRADED)
    middles = (GRADED[:-1] + GRADED[1:]) / 2
    np.testing.assert_array_equal(space.greville(2), GRADED)
    np.testing.assert_allclose(space.greville(1), np.concatenate([[0.0], middles, [1.0]]), atol=1e-15)
    np.testing.assert_array_equal(space.greville(3), middles)
    assert space.greville(0)[1] == pytest.approx(GRADED[1] / 3)


@pytest.mark.parametrize("space", SPACES)
def test_greville_points_are_the_coefficients_of_the_identity(space):
    np.testing.assert_allclose(space.evaluate(space.greville(0), space.knots), space.knots, atol=1e-15)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
def test_quadrature_is_exact_for_polynomials_up_to_the_degree(space, derivative):
    points, weights = space.greville(derivative), space.quadrature_weights(derivative)
    for power in range(4 - derivative):
        assert weights @ points**power == pytest.approx(1 / (power + 1), abs=1e-14)


@pytest.mark.parametrize("space", SPACES)
def test_quadrature_of_the_first_derivative_is_the_difference_of_the_ends(space):
    weights = space.quadrature_weights(1)
    ends = space.matrix([0.0, 1.0]).toarray()
    np.testing.assert_allclose(weights @ space.matrix(space.greville(1), 1), ends[1] - ends[0], atol=1e-14)


def test_quadrature_of_the_second_derivative_is_the_trapezoidal_rule():
    steps = np.diff(GRADED)
    expected = (np.concatenate([steps, [0]]) + np.concatenate([[0], steps])) / 2
    np.testing.assert_allclose(CubicSplineSpace(GRADED).quadrature_weights(2), expected, atol=1e-16)


def test_interpolation_takes_the_values_of_several_columns():
    space = CubicSplineSpace(GRADED)
    values = RNG.normal(size=(space.dimension, 3))
    coefficients = space.interpolate(values)
    np.testing.assert_allclose(space.evaluate(coefficients, space.interpolation_points), values, atol=1e-13)
    np.testing.assert_array_equal(space.interpolate(values[:, 1]), coefficients[:, 1])


def test_interpolation_of_a_smooth_function_has_order_four():
    points = np.linspace(0, 1, 2001)
    errors = []
    for intervals in (16, 32, 64):
        space = CubicSplineSpace.uniform(intervals)
        coefficients = space.interpolate(np.exp(np.sin(5 * space.interpolation_points)))
        errors.append(np.abs(space.evaluate(coefficients, points) - np.exp(np.sin(5 * points))).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(orders > 3.7)
    assert np.all(orders < 4.5)


@pytest.mark.parametrize(
    ("coarse", "fine"),
    [
        (np.arange(9) / 8, np.arange(17) / 16),
        (np.linspace(0, 1, 41), np.linspace(0, 1, 121)),  # knots equal but for rounding
        (GRADED, np.union1d(GRADED, [1 / 32, 3 / 16, 0.3, 0.6, 0.9])),
        (GRADED, GRADED),
    ],
)
def test_prolongation_is_the_same_function(coarse, fine):
    space, finer = CubicSplineSpace(coarse), CubicSplineSpace(fine)
    coefficients = RNG.normal(size=(space.dimension, 2))
    prolonged = space.prolong(coefficients, finer)
    points = np.linspace(0, 1, 501)
    assert prolonged.shape == (finer.dimension, 2)
    np.testing.assert_allclose(
        finer.evaluate(prolonged, points), space.evaluate(coefficients, points), atol=1e-14
    )
    assert np.diff(space.prolongation(finer).indptr).max() <= 4


def test_prolongation_by_halving_has_the_known_subdivision_weights():
    """Interior rows of cubic subdivision: (1, 6, 1) / 8 and (4, 4) / 8 in turn."""
    prolongation = CubicSplineSpace.uniform(8).prolongation(CubicSplineSpace.uniform(16))
    assert np.diff(prolongation.indptr).max() == 3
    matrix = prolongation.toarray()
    np.testing.assert_allclose(matrix[9, 4:7], [1 / 8, 6 / 8, 1 / 8], atol=1e-15)
    np.testing.assert_allclose(matrix[8, 3:7], [0, 1 / 2, 1 / 2, 0], atol=1e-15)


def test_prolongation_to_knots_that_are_not_nested_is_refused():
    with pytest.raises(ValueError, match="contain every knot"):
        CubicSplineSpace.uniform(8).prolong(np.zeros(11), CubicSplineSpace.uniform(12))


@pytest.mark.parametrize(
    "knots",
    [[0, 1], [0, 0.5, 0.5, 1], [0, 0.6, 0.4, 1], [0, 1, 2], [0.1, 0.5, 1], [[0, 0.5, 1]], [0, np.nan, 1]],
)
def test_knots_that_do_not_ascend_from_zero_to_one_are_refused(knots):
    with pytest.raises(ValueError, match="knots must"):
        CubicSplineSpace(knots)


def test_arguments_outside_their_domain_are_refused():
    space = CubicSplineSpace.uniform(4)
    with pytest.raises(ValueError, match=r"\[0, 1\]"):
        space.matrix([0.5, 1.01])
    with pytest.raises(ValueError, match=r"\[0, 1\]"):
        space.evaluate(np.zeros(7), [np.nan])
    with pytest.raises(ValueError, match="derivative"):
        space.matrix([0.5], 4)
    with pytest.raises(ValueError, match="7 rows"):
        space.evaluate(np.zeros(6), [0.5])


def test_rounding_beyond_the_ends_is_forgiven():
    space = CubicSplineSpace.uniform(4)
    coefficients = RNG.normal(size=7)
    np.testing.assert_array_equal(
        space.evaluate(coefficients, [-1e-16, 1 + 2e-16]), space.evaluate(coefficients, [0.0, 1.0])
    )


@pytest.mark.parametrize("derivative", [1, 2])
def test_dual_values_undo_integration_against_the_cardinal_splines(derivative: int) -> None:
    """The integrals of f against all splines of the space give f back where f is one of them."""
    space = CubicSplineSpace([0.0, 0.1, 0.3, 0.4, 0.8, 1.0])
    generator = np.random.default_rng(5)
    wanted = space.matrix(space.greville(derivative), derivative) @ generator.standard_normal(space.dimension)
    points, shares = np.polynomial.legendre.leggauss(4)
    widths = np.diff(space.knots)
    inside = (space.knots[:-1, None] + widths[:, None] * (points + 1) / 2).ravel()
    # Values of cardinal splines at the quadrature points: evaluate the interpolant of each unit vector.
    rows = space.matrix(inside, derivative).toarray()
    at_points = space.matrix(space.greville(derivative), derivative).toarray()
    cardinal = rows @ np.linalg.pinv(at_points)
    weights = cardinal.T @ ((widths[:, None] * shares / 2).ravel() * (cardinal @ wanted))
    np.testing.assert_allclose(space.dual_values(weights, derivative), wanted, atol=1e-10)
