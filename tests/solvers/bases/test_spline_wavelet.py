"""The interval spline wavelets against their closed forms (corrected) and their defining properties."""

import numpy as np
import pytest

from solvers.bases.spline_wavelet import SplineWaveletBasis

RNG = np.random.default_rng(20140331)


def power(t, n):
    """The truncated power t_+^n."""
    return np.where(t >= 0, np.maximum(t, 0.0) ** n, 0.0)


def phi(t):
    return (
        power(t, 3) - 4 * power(t - 1, 3) + 6 * power(t - 2, 3) - 4 * power(t - 3, 3) + power(t - 4, 3)
    ) / 6


def phi_b(t):
    return (
        3 / 2 * power(t, 2)
        - 11 / 12 * power(t, 3)
        + 3 / 2 * power(t - 1, 3)
        - 3 / 4 * power(t - 2, 3)
        + 1 / 6 * power(t - 3, 3)
    )


def eta1(t):
    return power(1 - t, 3)


def eta2(t):
    return (
        2 * power(t, 1)
        - 3 * power(t, 2)
        + 7 / 6 * power(t, 3)
        - 4 / 3 * power(t - 1, 3)
        + 1 / 6 * power(t - 2, 3)
    )


def psi(t):
    return -3 / 7 * phi(2 * t) + 12 / 7 * phi(2 * t - 1) - 3 / 7 * phi(2 * t - 2)


def psi_b(t):
    return 24 / 13 * phi_b(2 * t) - 6 / 13 * phi(2 * t)


def psi_b0(t):
    return (312 * eta2(2 * t) - 96 * phi_b(2 * t) + 24 * phi(2 * t)) / 99


def psi_b1(t):
    return 182 / 181 * (psi(t) + psi_b(t) / 14)


def closed_forms(L, J, t):
    """All functions at t, in the order of equation (28) and then level by level: shape (len(t), N)."""
    columns = [eta1(t), eta2(t), phi_b(t), *(phi(t - k) for k in range(L - 3))]
    columns += [phi_b(L - t), eta2(L - t), eta1(L - t)]
    for j in range(J):
        n, s = 2**j * L, 2**j * t
        columns += [
            psi_b0(s),
            psi_b1(s),
            *(psi(s - k) for k in range(1, n - 3)),
            psi_b1(n - s),
            psi_b0(n - s),
        ]
    return np.transpose(columns)


def collocation_matrix(L, J):
    basis = SplineWaveletBasis(L, J)
    return basis.matrix(basis.points).toarray()


@pytest.mark.parametrize(("L", "J"), [(5, 0), (5, 1), (8, 2), (7, 3)])
def test_every_function_has_its_closed_form(L, J):
    basis = SplineWaveletBasis(L, J)
    t = np.linspace(0, L, 301)
    # Truncated powers cancel: they lose as many digits as s^3 has.
    tolerance = 1e-14 * (2**J * L) ** 3
    np.testing.assert_allclose(basis.matrix(t).toarray(), closed_forms(L, J, t), atol=tolerance)


def test_known_values_of_the_scaling_functions():
    values = SplineWaveletBasis(8, 0).matrix([0.0, 1.0, 2.0, 3.0, 4.0]).toarray()
    np.testing.assert_allclose(values[:, 0], [1, 0, 0, 0, 0], atol=1e-15)  # eta1
    np.testing.assert_allclose(values[:, 1], [0, 1 / 6, 0, 0, 0], atol=1e-15)  # eta2
    np.testing.assert_allclose(values[:, 2], [0, 7 / 12, 1 / 6, 0, 0], atol=1e-15)  # phi_b
    np.testing.assert_allclose(values[:, 3], [0, 1 / 6, 2 / 3, 1 / 6, 0], atol=1e-15)  # phi


def test_derivatives_are_with_respect_to_tau():
    """eta1'(0) = -3, eta2'(0) = 2, phi_b''(0) = 3, phi'(1) = 1/2, phi''(1) = 1, phi''(2) = -2."""
    basis = SplineWaveletBasis(8, 0)
    first, second = (basis.matrix([0.0, 1.0, 2.0], order).toarray() for order in (1, 2))
    np.testing.assert_allclose(first[0, :4], [-3, 2, 0, 0], atol=1e-14)
    np.testing.assert_allclose(first[:, 3], [0, 1 / 2, 0], atol=1e-14)
    assert second[0, 2] == pytest.approx(3)
    np.testing.assert_allclose(second[:, 3], [0, 1, -2], atol=1e-13)


def test_points_of_each_level():
    basis = SplineWaveletBasis(5, 2)
    v0, w0, w1 = basis.levels(basis.points)
    np.testing.assert_array_equal(v0, [0, 0.5, 1, 2, 3, 4, 4.5, 5])
    np.testing.assert_array_equal(w0, [0.25, 1.5, 2.5, 3.5, 4.75])
    np.testing.assert_array_equal(w1, [0.125, 0.75, 1.25, 1.75, 2.25, 2.75, 3.25, 3.75, 4.25, 4.875])
    assert basis.order == ["V0", "W0", "W1"]
    assert basis.dimension == 23


def test_all_points_together_are_those_of_spline_interpolation():
    basis = SplineWaveletBasis(8, 3)
    np.testing.assert_allclose(np.sort(basis.points), 8 * basis.spline.interpolation_points, atol=1e-15)


@pytest.mark.parametrize(("L", "J"), [(5, 3), (8, 4)])
def test_wavelets_vanish_at_the_points_of_all_coarser_levels(L, J):
    matrix = collocation_matrix(L, J)
    start = L + 3
    for level in range(J):
        stop = start + 2**level * L
        assert np.abs(matrix[:start, start:stop]).max() < 1e-14
        start = stop


def test_within_a_level_interpolation_is_tridiagonal_with_the_known_entries():
    basis = SplineWaveletBasis(8, 2)
    block = collocation_matrix(8, 2)[19:, 19:]
    assert block.shape == (16, 16)
    np.testing.assert_allclose(np.diag(block), 1, atol=1e-14)
    outside = np.abs(np.subtract.outer(np.arange(16), np.arange(16))) > 1
    assert np.abs(block[outside]).max() < 1e-14
    assert block[1, 0] == pytest.approx(4 / 99)  # psi_b0(3/2)
    assert block[2, 1] == pytest.approx(-13 / 181)  # psi_b1(5/2)
    np.testing.assert_allclose(np.diag(block, 1)[1:-1], [*[-1 / 14] * 12, -13 / 181], atol=1e-14)
    np.testing.assert_allclose(np.diag(block, -1)[2:-1], -1 / 14, atol=1e-14)
    np.testing.assert_allclose(block, block[::-1, ::-1], atol=1e-14)  # reflections
    assert basis.order[-1] == "W1"


@pytest.mark.parametrize(("J", "condition"), [(1, 6.7), (4, 21.0)])
def test_condition_number_of_the_values(J, condition):
    assert np.linalg.cond(collocation_matrix(8, J)) == pytest.approx(condition, rel=0.02)


@pytest.mark.parametrize(("L", "J"), [(8, 0), (5, 1), (8, 4), (11, 6), (8, 13)])
def test_transforms_invert_each_other(L, J):
    basis = SplineWaveletBasis(L, J)
    coefficients = RNG.normal(size=(basis.dimension, 2))
    np.testing.assert_allclose(basis.to_spline(basis.from_spline(coefficients)), coefficients, atol=1e-12)
    np.testing.assert_allclose(basis.from_spline(basis.to_spline(coefficients)), coefficients, atol=1e-12)
    np.testing.assert_array_equal(
        basis.from_spline(coefficients[:, 1]), basis.from_spline(coefficients)[:, 1]
    )


def test_both_bases_give_the_same_function_by_the_closed_forms():
    basis = SplineWaveletBasis(8, 3)
    in_splines = RNG.normal(size=basis.dimension)
    t = np.linspace(0, 8, 401)
    values = closed_forms(8, 3, t) @ basis.from_spline(in_splines)
    np.testing.assert_allclose(values, basis.spline.evaluate(in_splines, t / 8), atol=1e-8)


@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
def test_both_bases_give_the_same_derivatives_on_a_fine_level(derivative):
    basis = SplineWaveletBasis(8, 13)
    smooth = basis.spline.interpolate(np.sin(9 * basis.spline.interpolation_points))
    t = np.sort(RNG.uniform(0, 8, size=200))
    by_wavelets = basis.matrix(t, derivative) @ basis.from_spline(smooth)
    by_splines = basis.spline.evaluate(smooth, t / 8, derivative) / 8.0**derivative
    step = 2.0**-13
    np.testing.assert_allclose(by_wavelets, by_splines, atol=1e-14 / step**derivative)


def test_fast_transform_solves_the_full_interpolation_problem():
    basis = SplineWaveletBasis(8, 4)
    values = np.exp(-((basis.points - 3) ** 2))
    by_solving = np.linalg.solve(collocation_matrix(8, 4), values)
    ascending = np.argsort(basis.points)
    by_transform = basis.from_spline(basis.spline.interpolate(values[ascending]))
    np.testing.assert_allclose(by_transform, by_solving, atol=1e-14)


def test_transform_work_grows_no_faster_than_the_number_of_points():
    """Stored entries of all operators of both transforms, per point: about the same at N = 131 and 4,099."""

    def entries(J):
        basis = SplineWaveletBasis(8, J)
        operators = [*basis._prolongations, *basis._restrictions, *basis._wavelets]
        return sum(operator.nnz for operator in operators) / basis.dimension

    assert entries(9) < 1.1 * entries(4)


def test_coefficients_of_a_smooth_function_fall_by_sixteen_a_level():
    basis = SplineWaveletBasis(8, 7)
    coefficients = basis.from_spline(
        basis.spline.interpolate(np.sin(2 * basis.spline.interpolation_points + 1))
    )
    largest = [np.abs(level).max() for level in basis.levels(coefficients)[3:]]
    ratios = np.divide(largest[:-1], largest[1:])
    np.testing.assert_allclose(ratios, 16, rtol=0.1)


def test_a_cubic_has_no_wavelet_coefficients():
    basis = SplineWaveletBasis(6, 4)
    t = basis.spline.interpolation_points
    coefficients = basis.from_spline(basis.spline.interpolate(2 - t + 3 * t**2 - t**3))
    assert np.abs(coefficients[9:]).max() < 1e-14
    assert np.abs(coefficients[:9]).min() > 0.1


def test_large_coefficients_stand_only_near_a_kink():
    basis = SplineWaveletBasis(8, 8)
    kink = 3.3
    values = np.abs(8 * basis.spline.interpolation_points - kink)
    coefficients = basis.from_spline(basis.spline.interpolate(values))
    points = basis.levels(basis.points)
    for level, (tau, row) in enumerate(zip(points[1:], basis.levels(coefficients)[1:], strict=True)):
        step = 2.0**-level
        large = np.abs(row) > 1e-3 * np.abs(row).max()
        assert np.abs(row).max() > 0.01 * step
        assert np.abs(tau[large] - kink).max() < 8 * step
        assert large.sum() <= 12


def test_split_by_level_covers_all_coefficients_in_order():
    basis = SplineWaveletBasis(8, 3)
    coefficients = np.arange(2.0 * basis.dimension).reshape(-1, 2)
    levels = basis.levels(coefficients)
    assert [level.shape for level in levels] == [(11, 2), (8, 2), (16, 2), (32, 2)]
    np.testing.assert_array_equal(np.concatenate(levels), coefficients)


def test_arguments_outside_their_domain_are_refused():
    with pytest.raises(ValueError, match="L > 4"):
        SplineWaveletBasis(4, 2)
    with pytest.raises(ValueError, match="level J"):
        SplineWaveletBasis(8, -1)
    with pytest.raises(ValueError, match="need 19 rows"):
        SplineWaveletBasis(8, 1).to_spline(np.zeros(18))
    with pytest.raises(ValueError, match="need 19 rows"):
        SplineWaveletBasis(8, 1).from_spline(np.zeros(20))
