"""Problems with known answers, as job documents."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from tests.bad_documents import FLEXIBLE_SPACECRAFT

RIGID_BODY: dict[str, Any] = {
    "problem": {
        "model": {
            "kind": "mechanical",
            "coordinates": ["x"],
            "controls": ["u"],
            "parameters": {"m": 1},
            "mass": [["m"]],
            "input": [[1]],
        },
        "final_time": [0.1, 10],
        "initial_state": {"x": 0, "x_dot": 0},
        "final_state": {"x": 1, "x_dot": 0},
        "bounds": {"u": [-1, 1]},
        "objective": {"terminal": "tf"},
    }
}

# x' = u, minimise the integral of (x^2 + u^2) / 2 over [0, 1] from x = 1: x = cosh(1 - t) / cosh(1),
# u = -sinh(1 - t) / cosh(1), J = tanh(1) / 2.
REGULATOR: dict[str, Any] = {
    "problem": {
        "model": {"kind": "first_order", "states": ["x"], "controls": ["u"], "dynamics": {"x": "u"}},
        "final_time": 1,
        "initial_state": {"x": 1},
        "objective": {"running": "(x^2 + u^2)/2"},
    }
}

# x'' + x = u from rest at 0 to rest at 1 in time 2 with the smallest integral of u^2 / 2. The costate of the
# velocity solves the same equation without force: u = a cos(t) + b sin(t).
OSCILLATOR: dict[str, Any] = {
    "problem": {
        "model": {
            "kind": "mechanical",
            "coordinates": ["x"],
            "controls": ["u"],
            "mass": [[1]],
            "stiffness": [[1]],
            "input": [[1]],
        },
        "final_time": 2,
        "initial_state": {"x": 0, "x_dot": 0},
        "final_state": {"x": 1, "x_dot": 0},
        "objective": {"running": "u^2/2"},
    }
}

# x' = a u.
INTEGRATOR: dict[str, Any] = {
    "kind": "first_order",
    "states": ["x"],
    "controls": ["u"],
    "parameters": {"a": 1},
    "dynamics": {"x": "a*u"},
}

# The same over a second, for a = 1 and a = 2.
TWO_PLANTS: dict[str, Any] = {
    "problem": {
        "model": INTEGRATOR,
        "final_time": 1,
        "initial_state": {"x": 0},
        "scenarios": {"cases": [{"name": "twice", "parameters": {"a": 2}}]},
    },
    "method": {"name": "swcm", "J": 2},
}


@pytest.fixture
def flexible_spacecraft() -> dict[str, Any]:
    return {"problem": copy.deepcopy(FLEXIBLE_SPACECRAFT["problem"])}


@pytest.fixture
def rigid_body() -> dict[str, Any]:
    return copy.deepcopy(RIGID_BODY)


@pytest.fixture
def regulator() -> dict[str, Any]:
    return copy.deepcopy(REGULATOR)


@pytest.fixture
def oscillator() -> dict[str, Any]:
    return copy.deepcopy(OSCILLATOR)


@pytest.fixture
def two_plants() -> dict[str, Any]:
    return copy.deepcopy(TWO_PLANTS)
