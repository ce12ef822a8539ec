"""Small documents with the method ``piecewise``: fractions of a second each."""

from __future__ import annotations

import copy
from typing import Any

PENDULUM: dict[str, Any] = {
    "name": "A pendulum swings to the other side and back",
    "problem": {
        "model": {
            "kind": "first_order",
            "states": ["angle", "rate", "phase"],
            "controls": ["torque"],
            "parameters": {"stiffness": 1.0, "beat": 0.5},
            "dynamics": {
                "angle": "rate",
                "rate": "torque - stiffness*angle + 0.1*sin(phase)",
                "phase": "beat",
            },
        },
        "final_time": 6,
        "initial_state": {"angle": 1, "rate": 0, "phase": 0.3},
        "bounds": {"torque": [-1, 1], "rate": [-0.7, 0.7]},
        "objective": {"running": "angle^2 + 0.1*torque^2"},
    },
    "method": {
        "name": "piecewise",
        "segments": {"by": "time", "length": 1.5},
        "nodes": 6,
        "tracking": {"Q": {"angle": 0.01, "rate": 0.01}, "R": {"torque": 0.5}},
        "margins": {"rate": 0.03},
        "plant": {
            "model": {
                "kind": "mechanical",
                "coordinates": ["q"],
                "controls": ["torque"],
                "parameters": {"beat": 0.5},
                "mass": [[2]],
                "input": [[2]],
                "force": ["-2*sin(q) + 0.2*sin(beat*t + 0.3)"],
            },
            "observe": {"angle": "q", "rate": "q_dot", "phase": "0.3 + beat*t"},
            "start": {"q": "angle", "q_dot": "rate"},
        },
    },
}
"""By time, with a state that no control reaches; the plant is nonlinear and written in other names."""

CART: dict[str, Any] = {
    "name": "A cart crosses the yard in minimum time",
    "problem": {
        "model": {
            "kind": "first_order",
            "states": ["x", "v"],
            "controls": ["u"],
            "parameters": {"far": 10},
            "dynamics": {"x": "v", "v": "u"},
        },
        "final_time": [0.1, 100],
        "initial_state": {"x": 0, "v": 0},
        "final_state": {"x": "far", "v": [None, 1]},
        "bounds": {"u": [-1, 1], "v": [0, 2]},
        "objective": {"terminal": "tf"},
        "guess": {"final_time": 12},
    },
    "method": {
        "name": "piecewise",
        "segments": {"by": "x", "count": 5},
        "nodes": 5,
        "lookahead": "end",
        "tracking": {"Q": {"x": 0.1, "v": 0.1}, "R": {"u": 0.5}},
        "margins": {"v": 0.02},
        "plant": {
            "model": {
                "kind": "first_order",
                "states": ["x", "v"],
                "controls": ["u"],
                "dynamics": {"x": "v", "v": "u - 0.01*v"},
            }
        },
    },
}
"""By a state, in unknown time, to an end; the plant has the same names and a little friction."""


def changed(document: dict[str, Any], pointer: str, value: Any) -> dict[str, Any]:
    """A copy with one value set."""
    copied = copy.deepcopy(document)
    *way, last = pointer.split("/")[1:]
    place: Any = copied
    for step in way:
        place = place[step]
    place[last] = value
    return copied
