"""The density of the atmosphere: the published order of magnitude, and never a look at the network."""

from __future__ import annotations

import socket

import pytest

from solvers.space.atmosphere import density
from solvers.space.earth import EQUATORIAL_RADIUS


def test_density_falls_as_it_should_and_asks_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(socket, "create_connection", refuse)
    at = [density((EQUATORIAL_RADIUS + 1000 * height, 0.0, 0.0), 0.0, 150.0, 4.0) for height in (0, 400, 750)]
    # Sea level, and the standard atmospheres of a moderate Sun (Montenbruck, Gill 2000, 3.5).
    assert at[0] == pytest.approx(1.2, rel=0.1)
    assert 1e-12 < at[1] < 1e-11
    assert 5e-15 < at[2] < 1e-13


def test_a_brighter_sun_makes_it_denser() -> None:
    place = 0.0, EQUATORIAL_RADIUS + 750e3, 0.0
    assert density(place, 0.0, 200.0, 4.0) > 1.5 * density(place, 0.0, 150.0, 4.0)
