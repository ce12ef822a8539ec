"""Modal models against the mechanical equations that they stand for, and what results say of a model."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from tests.solvers.output.test_outputs import each_method, result_of

# The flexible spacecraft at rest: J = 440 + 2*10*(2.5 + 5)^2, M_ee = 500, coupling 750, K_ee = 200.
INERTIA, OWN, MIXED, SPRING = 1565.0, 500.0, 750.0, 200.0
DELTA = MIXED / np.sqrt(OWN)
CONSTRAINED = np.sqrt(SPRING / OWN)
FREE = np.sqrt(SPRING / (OWN - MIXED**2 / INERTIA))


def slew(model: dict[str, Any], flexible: str) -> dict[str, Any]:
    return {
        "problem": {
            "model": {"controls": ["T"], **model},
            "final_time": [1, 100],
            "initial_state": {"*": 0},
            "final_state": {"theta": "pi/6", "theta_dot": 0, flexible: 0, f"{flexible}_dot": 0},
            "bounds": {"T": [-5, 5]},
            "objective": {"terminal": "tf"},
            "guess": {"final_time": 30},
        },
        "options": {"tolerance": 1e-12},
    }


MECHANICAL = {
    "kind": "mechanical",
    "coordinates": ["theta", "alpha"],
    "mass": [[INERTIA, MIXED], [MIXED, OWN]],
    "damping": {"diag": [0, 2 * 0.01 * CONSTRAINED * OWN]},
    "stiffness": {"diag": [0, SPRING]},
    "input": [[1], [0]],
    "flexible": ["alpha"],
}
MODAL = {
    "kind": "modal",
    "axes": ["theta"],
    "parameters": {"f1": CONSTRAINED / (2 * np.pi), "d": DELTA},
    "inertia": [[INERTIA]],
    "input": [[1]],
    "modes": [{"name": "p1", "frequency_hz": "f1", "damping": 0.01, "coupling": ["d"]}],
    "mode_basis": "constrained",
}


@each_method
@pytest.mark.parametrize("refine", [None, "switching"])
def test_a_modal_model_is_its_mechanical_one(method: dict[str, Any], refine: str | None) -> None:
    method = {**method, "refine": refine}
    mechanical = result_of({**slew(MECHANICAL, "alpha"), "method": method})
    modal = result_of({**slew(MODAL, "p1"), "method": method})
    assert modal["final_time"] == pytest.approx(mechanical["final_time"], abs=1e-9)
    for name, other, unit in (("theta", "theta", 1.0), ("alpha", "p1", np.sqrt(OWN))):
        np.testing.assert_allclose(
            unit * np.array(mechanical["trajectory"]["states"][name]),
            modal["trajectory"]["states"][other],
            atol=1e-6,
        )
    energies = [np.array(one["trajectory"]["outputs"]["vibration_energy"]) for one in (mechanical, modal)]
    np.testing.assert_allclose(*energies, atol=1e-7)


def test_free_modes_are_the_same_body_as_constrained_ones() -> None:
    """A free mode of unit mass turns the hub by -(delta/J)/sqrt(1 - delta^2/J); its frequency is higher."""
    undamped = copy.deepcopy(MODAL)
    undamped["modes"][0]["damping"] = 0
    free = copy.deepcopy(undamped)
    free["mode_basis"] = "free"
    left = 1 - DELTA**2 / INERTIA
    free["parameters"] = {"f1": FREE / (2 * np.pi), "d": -DELTA / INERTIA / np.sqrt(left)}
    method = {"name": "swcm", "refine": "switching"}
    times = [result_of({**slew(model, "p1"), "method": method}) for model in (undamped, free)]
    assert times[1]["final_time"] == pytest.approx(times[0]["final_time"], abs=1e-9)
    for result in times:
        report = result["model_report"]["initial"]
        assert report["natural_frequencies_hz"] == pytest.approx([FREE / (2 * np.pi)], rel=1e-12)


def test_three_axes_with_modes() -> None:
    """Free frequencies by the eigenvalues of M^-1 K that NumPy finds in matrices written down here."""
    inertia = np.array([[900.0, 20, -10], [20, 700, 5], [-10, 5, 800]])
    couplings = np.array([[5.0, 1, 0], [0, -12, 2], [3, 0, 9]])
    omegas = 2 * np.pi * np.array([0.3, 0.5, 1.1])
    model = {
        "kind": "modal",
        "axes": ["roll", "pitch", "yaw"],
        "controls": ["Tx", "Ty", "Tz"],
        "inertia": {
            "entries": [[i, j, inertia[i, j]] for i in range(3) for j in range(i + 1)],
            "symmetric": True,
        },
        "input": {"diag": [1, 1, 1]},
        "modes": [
            {"name": f"p{k}", "frequency_hz": omegas[k] / (2 * np.pi), "coupling": couplings[k].tolist()}
            for k in range(3)
        ],
        "mode_basis": "constrained",
    }
    names = ["roll", "pitch", "yaw", "p0", "p1", "p2"]
    document = slew(model, "p0")
    document["problem"] |= {
        "final_time": 20,
        "final_state": {**{f"{name}_dot": 0 for name in names}, **dict.fromkeys(names, 0), "yaw": 0.5},
        "bounds": {},
        "objective": {"running": "Tx^2 + Ty^2 + Tz^2"},
    }
    document["options"] = {}
    report = result_of({**document, "method": {"name": "swcm", "J": 5}})["model_report"]
    mass = np.block([[inertia, couplings.T], [couplings, np.eye(3)]])
    squares = np.linalg.eigvals(np.linalg.solve(mass, np.diag([0, 0, 0, *omegas**2])))
    expected = np.sort(np.sqrt(squares[squares > 1e-6])) / (2 * np.pi)
    for end in ("initial", "final"):
        np.testing.assert_allclose(report[end]["natural_frequencies_hz"], expected, rtol=1e-10)
        assert report[end]["smallest_mass_eigenvalue"] == pytest.approx(np.linalg.eigvalsh(mass)[0])


def test_the_report_of_the_nonlinear_spacecraft(flexible_spacecraft: dict[str, Any]) -> None:
    flexible_spacecraft["problem"]["model"]["damping"] = {"diag": [0, 5]}
    report = result_of({**flexible_spacecraft, "method": {"name": "swcm"}})["model_report"]
    # One free mode; at rest its damping is that of the free coordinate with the mass 500 - 750^2/1565.
    left = OWN - MIXED**2 / INERTIA
    assert report["initial"]["natural_frequencies_hz"] == pytest.approx([FREE / (2 * np.pi)])
    assert report["initial"]["damping_ratios"] == pytest.approx([5 / (2 * np.sqrt(SPRING * left))])
    smallest = np.linalg.eigvalsh([[INERTIA, MIXED], [MIXED, OWN]])[0]
    assert report["initial"]["smallest_mass_eigenvalue"] == pytest.approx(smallest)


def test_the_report_of_a_model_of_first_order(regulator: dict[str, Any]) -> None:
    """x'' + 2 zeta w x' + w^2 x = u as two equations: w and zeta; a mere integrator has no frequency."""
    assert result_of({**regulator, "method": {"name": "swcm"}})["model_report"]["final"] == {
        "natural_frequencies_hz": [],
        "damping_ratios": [],
        "smallest_mass_eigenvalue": None,
    }
    problem = regulator["problem"]
    problem["model"] |= {"states": ["x", "v"], "dynamics": {"x": "v", "v": "u - 9*x - 0.6*v"}}
    problem["initial_state"] = {"x": 1, "v": 0}
    report = result_of({**regulator, "method": {"name": "gpm"}})["model_report"]["initial"]
    assert report["natural_frequencies_hz"] == pytest.approx([3 / (2 * np.pi)])
    assert report["damping_ratios"] == pytest.approx([0.1])
