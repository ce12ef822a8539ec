"""Sun and Moon against astropy (get_body, built-in ephemeris): good to seconds of arc."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from solvers.backends import NUMPY
from solvers.space.sun_moon import moon, sun
from solvers.symbolic import CASADI

# Days from J2000, Sun and Moon from the Earth's centre in m.
ASTROPY = [
    (0.0, [26484406930, -132759867389, -57557778945], [-291581697, -266691808, -76092203]),
    (1597.625, [83530774311, 115748189932, 50181463534], [333420412, 204529184, 83274311]),
    (4292.270833333489, [-147867027607, -21606826355, -9366542419], [-52061505, -341622022, -144697557]),
    (8997.5, [-127136805626, 75371362971, 32672984791], [313669612, -156085343, -88836636]),
]


@pytest.mark.parametrize(("days", "sun_place", "moon_place"), ASTROPY)
def test_places_equal_those_of_astropy(days: float, sun_place: list[float], moon_place: list[float]) -> None:
    for ours, theirs in ((sun, sun_place), (moon, moon_place)):
        miss = np.linalg.norm(np.array(ours(days, NUMPY.functions)) - theirs)
        assert miss < 2e-3 * np.linalg.norm(theirs)


def test_symbols_and_numbers_agree() -> None:
    days = ca.SX.sym("days")
    for body in (sun, moon):
        symbolic = ca.Function("place", [days], [ca.vertcat(*body(days, CASADI.functions))])
        np.testing.assert_allclose(symbolic(1234.5).full().ravel(), body(1234.5, NUMPY.functions), rtol=1e-12)
