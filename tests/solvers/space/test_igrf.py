"""The field against ppigrf 2.1.0 (IGRF-14), which evaluates Legendre functions of the colatitude."""

from __future__ import annotations

from datetime import datetime

import casadi as ca
import numpy as np
import pytest

from solvers.space.igrf import MagneticField

# Date, radius in km, colatitude and longitude in degrees; radial, south and east of ppigrf.igrf_gc in nT.
# fmt: off
PPIGRF = [
    ("2000-01-01T12:00:00", 7204.855062311778, 170.6330016423424, -128.10253942093186,
     37416.72880698872, -2649.7629436147213, 9586.079431313465),
    ("2000-01-01T12:00:00", 7916.360219497143, 56.3178299098769, -27.602478369872756,
     -16710.41747976197, -13394.87802069107, -2832.3419292449557),
    ("2000-01-01T12:00:00", 7719.3619848147355, 73.74664541007986, 17.85372756230143,
     -5331.998064932196, -18060.124186143817, -480.0405699337116),
    ("2013-07-09T00:00:00", 6416.08828365031, 135.37884645279038, 13.731592758940167,
     22337.030580062274, -10309.919268619622, -5494.408195771861),
    ("2013-07-09T00:00:00", 6908.267019833721, 141.62873791368438, -70.84986145500781,
     19785.68072608829, -15514.012160834685, 3082.506352916127),
    ("2013-07-09T00:00:00", 7109.857362386085, 24.49346380724249, -34.879324879033476,
     -38240.06908422414, -8104.068322279892, -2897.450255894034),
    ("2028-03-01T00:00:00", 6702.587896013312, 47.45408793909106, 90.13128214681893,
     -43228.08255939251, -21506.503624397857, 378.7118533209541),
    ("2028-03-01T00:00:00", 6827.929785007662, 87.34918442326267, 173.06539192844593,
     1748.3717495790524, -27201.893359337795, 4292.450507401549),
    ("2028-03-01T00:00:00", 7937.547237039576, 130.23739939846251, 14.841667997076314,
     14147.254239373833, -6989.941276701837, -3005.7345962362656),
    ("1987-12-31T06:00:00", 6822.2003931491, 29.25670957074771, 169.17314875780772,
     -41327.6311178203, -14270.113031953977, 224.9148368077183),
    ("1987-12-31T06:00:00", 7211.772512140385, 21.239944632267886, 44.45631199350015,
     -37628.143210148504, -7718.036773362337, 1241.4972687128352),
    ("1987-12-31T06:00:00", 7636.261456640735, 110.22759088849425, 150.22717372472493,
     21290.04351079611, -17768.71029474125, 2639.10184525519),
]
# fmt: on


@pytest.mark.parametrize(("date", "radius", "colatitude", "longitude", "radial", "south", "east"), PPIGRF)
def test_field_equals_ppigrf(
    date: str, radius: float, colatitude: float, longitude: float, radial: float, south: float, east: float
) -> None:
    days = (datetime.fromisoformat(date) - datetime(2000, 1, 1, 12)).total_seconds() / 86_400
    st, ct, sp, cp = (f(np.radians(angle)) for angle in (colatitude, longitude) for f in (np.sin, np.cos))
    axes = np.array([[st * cp, st * sp, ct], [ct * cp, ct * sp, -st], [-sp, cp, 0.0]])
    field = np.array(MagneticField.at(days)(*(1000 * radius * axes[0])))
    np.testing.assert_allclose(axes @ field * 1e9, [radial, south, east], rtol=0, atol=1e-9)


def test_field_is_regular_at_the_poles() -> None:
    field = MagneticField.at(0.0)
    np.testing.assert_allclose(field(0.0, 0.0, 7e6), field(1e-3, 0.0, 7e6), rtol=0, atol=1e-13)


def test_field_over_symbols_has_no_sources() -> None:
    place = ca.SX.sym("place", 3)
    field = ca.vertcat(*MagneticField.at(0.0, 7)(*ca.vertsplit(place)))
    jacobian = ca.Function("jacobian", [place], [ca.jacobian(field, place)])([6.9e6, 1.1e6, -0.9e6]).full()
    size = np.abs(jacobian).max()
    assert abs(np.trace(jacobian)) < 1e-12 * size
    np.testing.assert_allclose(jacobian, jacobian.T, atol=1e-12 * size)


def test_a_low_degree_is_part_of_the_whole() -> None:
    x = np.array([7e6, -2e6, 1e6])
    dipole = np.array(MagneticField.at(0.0, 1)(*x))
    seventh, whole = (np.array(MagneticField.at(0.0, degree)(*x)) for degree in (7, 13))
    assert np.linalg.norm(seventh - whole) < 0.5e-6 < np.linalg.norm(dipole - whole)


@pytest.mark.parametrize(
    ("days", "degree"), [(0.0, 0), (0.0, 14), (-40_000.0, 7), (11_000.0, 7), (np.nan, 7)]
)
def test_what_the_model_does_not_hold_is_refused(days: float, degree: int) -> None:
    with pytest.raises(ValueError, match=r"degree|1900"):
        MagneticField.at(days, degree)
