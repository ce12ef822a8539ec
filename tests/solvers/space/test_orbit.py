"""Orbits: Gauss's equations against Cartesian propagation, elements there and back, zonal gravity."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from solvers.backends import NUMPY
from solvers.space.earth import EQUATORIAL_RADIUS, GRAVITY, ZONAL, geodetic_height, zonal_acceleration
from solvers.space.equinoctial import axes_of, elements_of
from solvers.space.orbit import cartesian, gauss_rates, orbital_axes

Vector = NDArray[np.float64]
ELEMENTS = np.array([7.1e6, 0.3, np.radians(40), 0.03 * np.cos(1.0), 0.03 * np.sin(1.0), 0.5])


def perturbation(t: float) -> Vector:
    """An acceleration along track, normal and radial, of the size that a tether has."""
    return np.array([-6e-4 + 1e-4 * np.sin(t / 500), 2e-4 * np.cos(t / 700), 3e-4])


def test_gauss_equations_are_cartesian_propagation() -> None:
    def newton(t: float, y: Vector) -> Vector:
        place, speed = y[:3], y[3:]
        pull = -GRAVITY * place / np.linalg.norm(place) ** 3
        return np.concatenate([speed, pull + perturbation(t) @ orbital_axes(place, speed)])

    # Steps short enough that only rounding is left: it is the path in Cartesian axes that loses digits.
    tight = {"method": "DOP853", "rtol": 3e-14, "max_step": 50.0}
    start = np.concatenate(cartesian(ELEMENTS))
    flown = solve_ivp(newton, (0, 6000), start, atol=1e-9, **tight).y[:, -1]
    elements = solve_ivp(
        lambda t, e: gauss_rates(e, perturbation(t)), (0, 6000), ELEMENTS, atol=1e-14, **tight
    ).y[:, -1]
    place, _ = cartesian(elements)
    np.testing.assert_allclose(place, flown[:3], rtol=0, atol=1e-6)
    semi_major_axis = 1 / (2 / np.linalg.norm(flown[:3]) - flown[3:] @ flown[3:] / GRAVITY)
    assert elements[0] == pytest.approx(semi_major_axis, rel=0, abs=1e-6)


def test_the_energy_of_an_orbit_tells_its_semi_major_axis() -> None:
    place, speed = cartesian(ELEMENTS)
    energy = speed @ speed / 2 - GRAVITY / np.linalg.norm(place)
    assert energy == pytest.approx(-GRAVITY / (2 * ELEMENTS[0]), rel=1e-14)


@pytest.mark.parametrize("inclination", [0.0, 0.7, 2.0])
def test_equinoctial_elements_there_and_back(inclination: float) -> None:
    node, functions = 0.4, NUMPY.functions
    place, speed = cartesian(np.array([7.2e6, node, inclination, 0.02, -0.01, 0.9]))
    p, f, g, h, k, longitude = elements_of(tuple(place), tuple(speed), GRAVITY, functions)
    assert (h, k) == pytest.approx(
        np.tan(inclination / 2) * np.array([np.cos(node), np.sin(node)]), abs=1e-15
    )
    assert np.hypot(f, g) == pytest.approx(np.hypot(0.02, 0.01), rel=1e-12)
    axes = axes_of(h, k, longitude, functions)
    eta = 1 + f * np.cos(longitude) + g * np.sin(longitude)
    np.testing.assert_allclose(np.multiply(p / eta, axes.radial), place, rtol=1e-13, atol=1e-6)
    np.testing.assert_allclose(
        np.array([axes.along, axes.normal, axes.radial]), orbital_axes(place, speed), atol=1e-14
    )


def test_oblateness_in_closed_form() -> None:
    x, y, z = 6.5e6, 2.0e6, 3.1e6
    r = np.sqrt(x**2 + y**2 + z**2)
    factor = -1.5 * ZONAL[2] * GRAVITY * EQUATORIAL_RADIUS**2 / r**5
    across, along = factor * (1 - 5 * z**2 / r**2), factor * (3 - 5 * z**2 / r**2)
    ours = zonal_acceleration({2: ZONAL[2]}, x, y, z)
    np.testing.assert_allclose(ours, [across * x, across * y, along * z], rtol=1e-12)


@pytest.mark.parametrize("latitude", [-1.57, -0.6, 0.0, 0.3, 1.2])
def test_geodetic_height(latitude: float) -> None:
    height, e2 = 750e3, (2 - 1 / 298.257223563) / 298.257223563
    normal = EQUATORIAL_RADIUS / np.sqrt(1 - e2 * np.sin(latitude) ** 2)
    x, z = (normal + height) * np.cos(latitude), (normal * (1 - e2) + height) * np.sin(latitude)
    assert geodetic_height(0.6 * x, 0.8 * x, z) == pytest.approx((height, latitude), abs=1e-6)
