"""Gauss nodes, quadrature, interpolation and differentiation against tables and closed forms."""

from math import comb

import numpy as np
import pytest
from numpy.polynomial import legendre as polynomial

from solvers.bases.legendre import (
    barycentric_weights,
    differentiation_matrix,
    gauss_barycentric_weights,
    gauss_differentiation_matrix,
    gauss_support,
    lagrange_matrix,
    legendre_gauss,
)

COUNTS = [1, 2, 3, 5, 19, 40, 259, 512]
RNG = np.random.default_rng(1814)


@pytest.mark.parametrize(
    ("count", "nodes", "weights"),
    [
        (1, [0], [2]),
        (2, [-(3**-0.5), 3**-0.5], [1, 1]),
        (3, [-(0.6**0.5), 0, 0.6**0.5], [5 / 9, 8 / 9, 5 / 9]),
        (
            5,
            [-0.90617984593866399, -0.53846931010568309, 0, 0.53846931010568309, 0.90617984593866399],
            [0.23692688505618909, 0.47862867049936647, 128 / 225, 0.47862867049936647, 0.23692688505618909],
        ),
    ],
)
def test_nodes_and_weights_of_the_tables(count, nodes, weights):
    for found, expected in zip(legendre_gauss(count), (nodes, weights), strict=True):
        np.testing.assert_allclose(found, expected, rtol=3e-16, atol=2e-16)


def test_sixty_four_nodes_of_the_tables():
    """Abramowitz and Stegun, table 25.4: the innermost and the outermost of 64 nodes."""
    nodes, weights = legendre_gauss(64)
    assert nodes[32] == pytest.approx(0.024350292663424432509, rel=1e-14)
    assert weights[32] == pytest.approx(0.048690957009139720383, rel=1e-14)
    assert nodes[63] == pytest.approx(0.999305041735772139457, rel=1e-15)
    assert weights[63] == pytest.approx(0.001783280721696432947, rel=1e-13)


@pytest.mark.parametrize("count", COUNTS)
def test_nodes_are_roots_in_order_and_symmetric(count):
    nodes, weights = legendre_gauss(count)
    assert nodes.shape == weights.shape == (count,)
    assert np.all(np.diff(nodes) > 0)
    assert np.all(np.abs(nodes) < 1)
    np.testing.assert_array_equal(nodes, -nodes[::-1])
    np.testing.assert_array_equal(weights, weights[::-1])
    last = np.eye(count + 1)[count]
    slopes = polynomial.legval(nodes, polynomial.legder(last))
    np.testing.assert_allclose(polynomial.legval(nodes, last) / slopes, 0, atol=2e-16)


@pytest.mark.parametrize("count", COUNTS)
def test_quadrature_is_exact_to_degree_twice_the_count_less_one(count):
    nodes, weights = legendre_gauss(count)
    degree = 2 * count - 1
    moments = weights @ polynomial.legvander(nodes, degree)
    np.testing.assert_allclose(moments, 2 * np.eye(degree + 1)[0], atol=3e-14)
    if degree > 1:
        assert weights @ nodes ** (degree - 1) == pytest.approx(2 / degree, rel=1e-11)
    beyond = weights @ polynomial.legval(nodes, np.eye(degree + 2)[degree + 1])
    assert abs(beyond) > 1e-3


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("initial_point", [False, True])
def test_closed_form_of_the_barycentric_weights_agrees_with_their_products(count, initial_point):
    points = gauss_support(count) if initial_point else legendre_gauss(count)[0]
    closed = gauss_barycentric_weights(count, initial_point=initial_point)
    by_products = barycentric_weights(points)
    # Rounding of nodes 1e-5 apart costs the products digits that the closed form keeps.
    np.testing.assert_allclose(
        by_products * np.abs(closed).max() * np.sign(closed[0] * by_products[0]), closed, rtol=1e-10
    )


@pytest.mark.parametrize("count", [2, 10, 60, 512])
def test_barycentric_weights_of_equidistant_points_are_binomial(count):
    expected = np.array(
        [(-1.0) ** j * (comb(count - 1, j) / comb(count - 1, (count - 1) // 2)) for j in range(count)]
    )
    found = barycentric_weights(np.linspace(-1, 1, count))
    np.testing.assert_allclose(found * np.sign(found[0]), expected, rtol=1e-10)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_barycentric_weights_of_chebyshev_points_are_one_and_a_half_at_the_ends(scale):
    count = 512
    expected = (-1.0) ** np.arange(count)
    expected[[0, -1]] /= 2
    found = barycentric_weights(scale * np.cos(np.pi * np.arange(count) / (count - 1)))
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_one_point_has_weight_one_and_equal_points_are_refused():
    np.testing.assert_array_equal(barycentric_weights([0.3]), [1.0])
    with pytest.raises(ValueError, match="distinct"):
        barycentric_weights([0.0, 1.0, 0.0])


@pytest.mark.parametrize("count", COUNTS)
def test_interpolation_reproduces_polynomials_up_to_the_count_of_points_less_one(count):
    support = gauss_support(count)
    weights = gauss_barycentric_weights(count, initial_point=True)
    at = np.linspace(-1, 1, 201)
    coefficients = RNG.normal(size=count + 1) / (1 + np.arange(count + 1)) ** 2
    found = lagrange_matrix(support, weights, at) @ polynomial.legval(support, coefficients)
    np.testing.assert_allclose(found, polynomial.legval(at, coefficients), atol=1e-11)


def test_interpolation_at_the_points_takes_their_values():
    support = gauss_support(40)
    matrix = lagrange_matrix(support, barycentric_weights(support), np.concatenate([support[::-1], [0.1]]))
    np.testing.assert_array_equal(matrix[:-1], np.eye(41)[::-1])
    assert matrix[-1].sum() == pytest.approx(1, abs=1e-14)


@pytest.mark.parametrize("count", COUNTS)
def test_differentiation_is_exact_up_to_the_degree_of_the_count(count):
    support = gauss_support(count)
    matrix = gauss_differentiation_matrix(count)
    assert matrix.shape == (count, count + 1)
    rounding = 4 * np.finfo(float).eps * np.abs(matrix).sum(axis=1).max()
    for degree in {0, 1, count // 2, count}:
        legendre = np.eye(count + 1)[degree]
        expected = polynomial.legval(support[1:], polynomial.legder(legendre))
        steepest = degree * (degree + 1) / 2
        error = matrix @ polynomial.legval(support, legendre) - expected
        np.testing.assert_allclose(error, 0, atol=rounding + 1e-11 * steepest)


def test_differentiation_of_a_smooth_function_is_accurate_to_rounding():
    for count, tolerance in ((40, 2e-12), (131, 3e-11), (259, 3e-10)):
        support = gauss_support(count)
        found = gauss_differentiation_matrix(count) @ np.exp(support)
        np.testing.assert_allclose(found, np.exp(support[1:]), atol=tolerance)


def test_differentiation_matrix_of_two_and_three_points_by_hand():
    """D of {-1, 0}: the slope of a line. D of {-1, -1/sqrt 3, 1/sqrt 3} at the nodes: of a parabola."""
    np.testing.assert_allclose(gauss_differentiation_matrix(1), [[-1, 1]], atol=1e-15)
    values = differentiation_matrix([-1, 0, 1], barycentric_weights([-1, 0, 1]))
    np.testing.assert_allclose(values, [[-1.5, 2, -0.5], [-0.5, 0, 0.5], [0.5, -2, 1.5]], atol=1e-15)


@pytest.mark.parametrize("count", [2, 19, 259])
def test_quadrature_of_the_derivative_is_the_difference_of_the_ends(count):
    support = gauss_support(count)
    ends = lagrange_matrix(support, gauss_barycentric_weights(count, initial_point=True), [-1.0, 1.0])
    by_quadrature = legendre_gauss(count)[1] @ gauss_differentiation_matrix(count)
    np.testing.assert_allclose(by_quadrature, ends[1] - ends[0], atol=1e-10)


def test_what_a_caller_does_to_its_nodes_changes_no_others():
    nodes, weights = legendre_gauss(7)
    nodes[:], weights[:] = 0, 0
    assert legendre_gauss(7)[0][0] == pytest.approx(-0.94910791234275852, abs=1e-15)
    assert legendre_gauss(7)[1].sum() == pytest.approx(2, abs=1e-15)


def test_a_count_below_one_is_refused():
    for function in (legendre_gauss, gauss_support, gauss_differentiation_matrix):
        with pytest.raises(ValueError, match="1 or more"):
            function(0)
