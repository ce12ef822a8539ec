"""Daubechies' functions against the printed table, closed forms, and what defines them."""

from __future__ import annotations

import numpy as np
import pytest

from solvers.bases.daubechies import (
    INTERVAL_ORDERS,
    ORDERS,
    DaubechiesBasis,
    scaling_filter,
    scaling_integrals,
    scaling_values,
)

BASES = [
    DaubechiesBasis(2, 5),
    DaubechiesBasis(2, 5, 3),
    DaubechiesBasis(2, 1, 1),  # wrapped around more than once
    DaubechiesBasis(7, 6, 1),
    DaubechiesBasis(2, 3, 0, periodic=False),
    DaubechiesBasis(2, 5, 2, periodic=False),
    DaubechiesBasis(3, 9, 2, periodic=False),
    DaubechiesBasis(4, 12, 1, periodic=False),
]


def inner_products(basis: DaubechiesBasis) -> np.ndarray:
    """By the trapezoidal rule on fine dyadic points, extrapolated once."""
    products = []
    for level in (11, 12):
        values = basis.values(level)
        weights = np.full(values.shape[1], 1.0 / (values.shape[1] - 1))
        weights[[0, -1]] /= 2.0
        products.append(values * weights @ values.T)
    extrapolated: np.ndarray = 2.0 * products[1] - products[0]
    return extrapolated


def test_filter_of_order_2_in_closed_form() -> None:
    s = np.sqrt(3.0)
    np.testing.assert_allclose(scaling_filter(2), np.array([1 + s, 3 + s, 3 - s, 1 - s]) / 4, atol=1e-15)


@pytest.mark.parametrize(
    ("order", "first"),  # Daubechies (1988), Table 1, there with sum sqrt(2)
    [
        (3, [0.332670552950, 0.806891509311, 0.459877502118, -0.135011020010, -0.085441273882]),
        (4, [0.230377813309, 0.714846570553, 0.630880767930, -0.027983769417, -0.187034811719]),
        (10, [0.026670057901, 0.188176800078, 0.527201188932, 0.688459039454, 0.281172343661]),
    ],
)
def test_filters_of_the_printed_table(order: int, first: list[float]) -> None:
    np.testing.assert_allclose(scaling_filter(order)[:5] / np.sqrt(2.0), first, atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_filter_is_orthogonal_and_its_wavelet_has_vanishing_moments(order: int) -> None:
    taps = scaling_filter(order)
    for shift in range(order):
        assert taps[2 * shift :] @ taps[: taps.size - 2 * shift] == pytest.approx(
            2.0 * (shift == 0), abs=1e-13
        )
    places = np.arange(taps.size)
    for power in range(order):
        terms = (-1.0) ** places * (places / taps.size) ** power * taps
        assert abs(terms.sum()) <= 1e-13


def test_values_and_integrals_at_integers_in_closed_form() -> None:
    s = np.sqrt(3.0)
    np.testing.assert_allclose(scaling_values(2, 0), [0, (1 + s) / 2, (1 - s) / 2, 0], atol=1e-14)
    np.testing.assert_allclose(scaling_integrals(2, 0), [0, 0.84967937, 1.01634604, 1], atol=5e-9)


@pytest.mark.parametrize("order", [1, 11])
def test_orders_that_there_are_not(order: int) -> None:
    with pytest.raises(ValueError, match="between 2 and 10"):
        scaling_filter(order)


@pytest.mark.parametrize("order", ORDERS)
def test_two_scale_relation_and_partition_of_unity(order: int) -> None:
    taps, values, finer = scaling_filter(order), scaling_values(order, 3), scaling_values(order, 4)
    combined = np.zeros(finer.size)
    for n, tap in enumerate(taps):
        combined[8 * n : 8 * n + values.size] += tap * values
    np.testing.assert_allclose(finer, combined, atol=1e-12)
    np.testing.assert_allclose(values[:-1].reshape(-1, 8).sum(axis=0), 1.0, atol=1e-12)


@pytest.mark.parametrize("basis", BASES, ids=str)
def test_functions_are_orthogonal_and_as_many_as_named(basis: DaubechiesBasis) -> None:
    assert basis.values(8).shape == (basis.size, basis.units * 256 + 1)
    assert basis.blocks["V0"] == basis.scaling_functions
    # Trapezoids see kinks and jumps of the functions at the ends to about this accuracy.
    np.testing.assert_allclose(inner_products(basis) * basis.units, np.eye(basis.size), atol=5e-4)


@pytest.mark.parametrize("basis", BASES, ids=str)
def test_integrals_are_those_of_the_values(basis: DaubechiesBasis) -> None:
    values, integrals = basis.values(12), basis.integrals(12)
    width = 1.0 / (values.shape[1] - 1)
    sums = np.cumsum((values[:, 1:] + values[:, :-1]) / 2.0 * width, axis=1)
    np.testing.assert_allclose(integrals[:, 1:], sums, atol=4e-5)
    # Coarse points are among fine ones: both are exact.
    np.testing.assert_allclose(basis.values(5), values[:, ::128], atol=1e-10)
    np.testing.assert_allclose(basis.integrals(5), integrals[:, ::128], atol=1e-10)


def test_integrals_over_the_period() -> None:
    basis = DaubechiesBasis(3, 4, 2)
    ends = basis.integrals(4)[:, -1]
    np.testing.assert_allclose(ends, [0.25] * 4 + [0.0] * 12, atol=1e-14)


@pytest.mark.parametrize("order", INTERVAL_ORDERS)
@pytest.mark.parametrize("levels", [0, 1])
def test_on_the_interval_polynomials_are_reproduced(order: int, levels: int) -> None:
    basis = DaubechiesBasis(order, 3 * order, levels, periodic=False)
    table, x = basis.values(7), basis.points(7)
    for power in range(order):
        coefficients = np.linalg.lstsq(table.T, x**power)[0]
        np.testing.assert_allclose(coefficients @ table, x**power, atol=1e-9)
    coefficients = np.linalg.lstsq(table.T, x**order)[0]
    assert np.max(np.abs(coefficients @ table - x**order)) > 1e-6


def test_parabolas_keep_the_integrals() -> None:
    basis = DaubechiesBasis(2, 5, 1)
    parabolas, integrals = basis.parabolas(4), basis.integrals(4)
    simpson = (parabolas[:, :-2:2] + 4 * parabolas[:, 1::2] + parabolas[:, 2::2]) / 6 / 80
    np.testing.assert_allclose(np.cumsum(simpson, axis=1), integrals[:, 1:], atol=1e-14)
    np.testing.assert_array_equal(parabolas[:, ::2], basis.values(4))


def test_what_cannot_be_on_the_interval() -> None:
    with pytest.raises(ValueError, match="at least 3"):
        DaubechiesBasis(2, 2, periodic=False)
    with pytest.raises(ValueError, match="at most 4"):
        DaubechiesBasis(5, 20, periodic=False)
