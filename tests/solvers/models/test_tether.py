"""The electrodynamic tether: a first integral, and the angles of ``edt`` against the vectors of its plant."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from solvers.backends import NUMPY
from solvers.models import LIBRARY
from solvers.piecewise.equations import Equations
from solvers.spec import LibraryReference

Vector = NDArray[np.float64]
UNDISTURBED = dict.fromkeys(("oblateness", "third_body", "drag", "radiation"), 0)
# As heavy as a mountain: the force does not move the orbit, while the torque turns the tether as before.
STILL = {"mass": 1e15, "reduced": 1.3311011904761905, "offset": -0.23214285714285715}
RADIUS = 7_128_137.0


def library(name: str, **parameters: float) -> Equations:
    return Equations.of(LibraryReference.model_construct(kind="library", name=name, parameters=parameters))


def fly(equations: Equations, x: Any, seconds: float, current: float) -> Vector:
    def rate(t: float, y: Vector) -> Vector:
        return np.array(equations.rate(y, [current], t, NUMPY), np.float64)

    scale = 1e-3 * np.maximum(np.abs(x), 1e-3)
    flight = solve_ivp(rate, (0, seconds), x, method="DOP853", rtol=1e-12, atol=1e-12 * scale)
    return np.asarray(flight.y[:, -1])


def in_plant(simple: Equations, plant: Equations, x: Any) -> Vector:
    values = dict(zip(simple.states, x, strict=True)) | plant.parameters
    started = LIBRARY["edt_plant"].views["edt"].start(values, NUMPY.functions)
    return np.array([started[name] for name in plant.states], np.float64)


def observed(plant: Equations, y: Vector) -> dict[str, Any]:
    values = dict(zip(plant.states, y, strict=True)) | plant.parameters
    return LIBRARY["edt_plant"].views["edt"].observe(values, NUMPY.functions)


def test_jacobi_integral_of_a_free_tether_on_a_circle() -> None:
    edt = library("edt", igrf=0, oblateness=0)
    start = np.array([0.4, 2e-4, -0.3, 3e-4, RADIUS, 0, 0, 0, 0, 0.3])
    n = float(edt.scope(start, [0.0], 0.0, NUMPY)["turn"])

    def jacobi(x: Vector) -> float:
        a, a_rate, b, b_rate = x[:4]
        kinetic = (b_rate**2 + (a_rate * np.cos(b)) ** 2) / 2
        return float(kinetic - n**2 * np.cos(b) ** 2 * (1 + 3 * np.cos(a) ** 2) / 2)

    end = fly(edt, start, 18_000.0, 0.0)  # 3 orbits
    assert jacobi(end) == pytest.approx(jacobi(start), rel=1e-12)
    assert abs(end[0] - start[0]) > 1e-2


@pytest.mark.parametrize(("current", "igrf"), [(0.0, 0.0), (0.3, 0.0), (0.3, 1.0)])
def test_angles_and_vectors_agree_on_an_eccentric_inclined_orbit(current: float, igrf: float) -> None:
    common = {"igrf": igrf, **STILL}
    edt = library("edt", oblateness=0, **common)
    plant = library("edt_plant", **UNDISTURBED, **common)
    start = np.array([0.3, 1e-4, -0.2, 2e-4, RADIUS, 0.02, -0.03, 0.2, 0.3, 0.5])
    end = fly(edt, start, 6000.0, current)
    seen = observed(plant, fly(plant, in_plant(edt, plant, start), 6000.0, current))
    for index, name in enumerate(edt.states[:4]):
        assert seen[name] == pytest.approx(end[index], abs=2e-9 if index % 2 == 0 else 2e-12), name
    assert np.cos(seen["lon"] - end[9]) == pytest.approx(1.0, abs=1e-15)


def test_the_plant_is_seen_as_what_it_was_started_from() -> None:
    edt, plant = library("edt"), library("edt_plant")
    start = np.array([0.3, 1e-4, -0.2, 2e-4, RADIUS, 0.02, -0.03, 0.2, 0.3, 0.5])
    seen = observed(plant, in_plant(edt, plant, start))
    np.testing.assert_allclose([seen[name] for name in edt.states], start, rtol=1e-12, atol=1e-15)


def test_power_is_the_work_of_the_force_on_the_centre_of_mass() -> None:
    edt, plant = library("edt"), library("edt_plant", **UNDISTURBED | {"oblateness": 1})
    start = np.array([0.3, 1e-4, -0.2, 2e-4, RADIUS, 0.02, -0.03, 0.2, 0.3, 0.5])
    y = in_plant(edt, plant, start)
    held = {"rho": 0.0, "sunlight": 0.0}
    forces = []
    for current in (0.0, 0.3):
        scope = plant.scope(y, [current], 0.0, NUMPY, held)
        forces.append(np.array([scope[name] for name in ("ax", "ay", "az")]) * plant.parameters["mass"])
    power = (forces[1] - forces[0]) @ y[3:6]
    assert power < 0.0
    assert float(edt.scope(start, [0.3], 0.0, NUMPY)["power"]) == pytest.approx(power, rel=1e-9)


def test_a_circle_of_the_simple_model_is_a_circle_of_the_oblate_plant() -> None:
    edt, plant = library("edt"), library("edt_plant", **UNDISTURBED | {"oblateness": 1})
    y = in_plant(edt, plant, [0, 0, 0, 0, RADIUS, 0, 0, 0, 0, 0])
    for seconds in (1500.0, 3000.0):
        assert np.linalg.norm(fly(plant, y, seconds, 0.0)[:3]) == pytest.approx(RADIUS, abs=30.0)


def test_disturbances_have_the_size_of_the_literature() -> None:
    """Orders of magnitude at 750 km (Montenbruck, Gill 2000, figure 3.1)."""
    start = [0, 0, 0, 0, RADIUS, 0, 0, 0, 0, 0.5]

    def acceleration(current: float, **shares: float) -> Vector:
        plant = library("edt_plant", **UNDISTURBED | shares)
        scope = plant.scope(in_plant(library("edt"), plant, start), [current], 0.0, NUMPY)
        return np.array([scope[name] for name in ("ax", "ay", "az")], np.float64)

    calm = acceleration(0.0)
    for current, shares, size in (
        (0.4, {}, 6.1e-4),
        (0.0, {"oblateness": 1}, 1.0e-2),
        (0.0, {"third_body": 1}, 1.1e-6),
        (0.0, {"drag": 1}, 2.5e-8),
        (0.0, {"radiation": 1}, 2.6e-7),
    ):
        found = np.linalg.norm(acceleration(current, **shares) - calm)
        assert size / 3 < found < 3 * size, shares
