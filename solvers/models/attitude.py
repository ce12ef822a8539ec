"""A spacecraft that turns in space: quaternion, rates, full inertia, flexible modes, torques or wheels.

The quaternion (q1, q2, q3, q4), scalar last, turns vectors from body axes into inertial axes; w is the
angular velocity in body axes. J is the inertia of the whole in body axes, the modes are those of the
structure with its hub held fast (unit modal mass), mode k with the couplings dk1, dk2, dk3 to the axes:

    q' = 1/2 q (w, 0)
    J w' + sum_k d_k eta_k'' + w x H = T,          H = J w + sum_k d_k eta_k' + h
    eta_k'' + 2 z_k Om_k eta_k' + Om_k^2 eta_k + d_k' w' = 0,      Om_k = 2 pi f_k

With ``actuators`` "torque" T is a torque from outside and there is no h. With "wheels" T is the torque of
three wheels along the axes on the body, h' = -T their momentum, and J is without the inertia of the wheels
about their own axes: the momentum of the whole, H turned into inertial axes, stays as it is, whatever the
wheels do. The rates follow from D w' = T - w x H + sum_k d_k (2 z_k Om_k eta_k' + Om_k^2 eta_k) with
D = J - sum_k d_k d_k', which is constant and must be positive definite.

Sources: P. W. Likins, Dynamics and Control of Flexible Space Vehicles, JPL TR 32-1329, 1970 (hybrid
coordinates); B. Wie, Space Vehicle Dynamics and Control, 2nd ed., AIAA 2008, chapters 5 and 7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from solvers.models.library_model import LibraryModel, Option, Parameter, Quantity

MAX_MODES = 8
_AXES = (1, 2, 3)
_NEXT = {1: (2, 3), 2: (3, 1), 3: (1, 2)}
_QUATERNION = {
    "q1": "(q4*w1 - q3*w2 + q2*w3)/2",
    "q2": "(q3*w1 + q4*w2 - q1*w3)/2",
    "q3": "(q1*w2 - q2*w1 + q4*w3)/2",
    "q4": "-(q1*w1 + q2*w2 + q3*w3)/2",
}
_BODY_AXES = {
    "b1x": "q1^2 - q2^2 - q3^2 + q4^2",
    "b1y": "2*(q1*q2 + q3*q4)",
    "b1z": "2*(q1*q3 - q2*q4)",
    "b2x": "2*(q1*q2 - q3*q4)",
    "b2y": "q2^2 - q1^2 - q3^2 + q4^2",
    "b2z": "2*(q2*q3 + q1*q4)",
    "b3x": "2*(q1*q3 + q2*q4)",
    "b3y": "2*(q2*q3 - q1*q4)",
    "b3z": "q3^2 - q1^2 - q2^2 + q4^2",
}
"""Components of the body axes along the inertial axes, for pointing constraints."""


def _entry(letter: str, i: int, j: int) -> str:
    """The name of an entry of a symmetric matrix."""
    return f"{letter}{min(i, j)}{max(i, j)}"


def _minor(i: int, j: int) -> str:
    """The cofactor of an entry of D."""
    (a, b), (c, d) = _NEXT[i], _NEXT[j]
    return f"({_entry('D', a, c)}*{_entry('D', b, d)} - {_entry('D', a, d)}*{_entry('D', b, c)})"


def _parameters(modes: int) -> dict[str, Parameter]:
    upper = [(i, j) for i in _AXES for j in _AXES if i <= j]
    found = {
        f"J{i}{j}": Parameter(float(i == j), "kg m^2", f"inertia of the whole, axes {i} and {j}")
        for i, j in upper
    }
    for k in range(1, modes + 1):
        found[f"f{k}"] = Parameter(float(k), "Hz", f"frequency of mode {k} with the hub held fast")
        found[f"z{k}"] = Parameter(0.005, "1", f"damping ratio of mode {k}")
        for i in _AXES:
            value = 0.3 if (k - 1) % 3 + 1 == i else 0.0
            found[f"d{k}{i}"] = Parameter(value, "sqrt(kg) m", f"coupling of mode {k} to axis {i}")
        found[f"Om{k}"] = Parameter(f"2*pi*f{k}", "rad/s", f"frequency of mode {k}; follows from f{k}")
    for i, j in upper:
        taken = "".join(f" - d{k}{i}*d{k}{j}" for k in range(1, modes + 1))
        found[f"D{i}{j}"] = Parameter(f"J{i}{j}{taken}", "kg m^2", "inertia without the modes; follows")
    found["D2"] = Parameter("D11*D22 - D12^2", "kg^2 m^4", "second leading minor of D; follows")
    found["D3"] = Parameter(
        " + ".join(f"D1{j}*{_minor(1, j)}" for j in _AXES), "kg^3 m^6", "determinant of D; follows"
    )
    for i, j in upper:
        found[f"A{i}{j}"] = Parameter(f"{_minor(i, j)}/D3", "1/(kg m^2)", "inverse of D; follows")
    return found


def _definitions(modes: int, *, wheels: bool) -> dict[str, str]:
    numbers = range(1, modes + 1)
    found = {f"r{k}": f"2*z{k}*Om{k}*eta{k}_dot + Om{k}^2*eta{k}" for k in numbers}
    for i in _AXES:
        terms = [f"{_entry('J', i, j)}*w{j}" for j in _AXES]
        terms += [f"d{k}{i}*eta{k}_dot" for k in numbers] + [f"h{i}"] * wheels
        found[f"H{i}"] = " + ".join(terms)
    for i in _AXES:
        after, before = _NEXT[i]
        springs = "".join(f" + d{k}{i}*r{k}" for k in numbers)
        found[f"g{i}"] = f"T{i} - w{after}*H{before} + w{before}*H{after}{springs}"
    for i in _AXES:
        found[f"a{i}"] = " + ".join(f"{_entry('A', i, j)}*g{j}" for j in _AXES)
    if modes:
        found["modal_energy"] = " + ".join(f"(eta{k}_dot^2 + Om{k}^2*eta{k}^2)/2" for k in numbers)
    return found | _BODY_AXES


def _dynamics(modes: int, *, wheels: bool) -> dict[str, str]:
    numbers = range(1, modes + 1)
    found = _QUATERNION | {f"w{i}": f"a{i}" for i in _AXES}
    found |= {f"eta{k}": f"eta{k}_dot" for k in numbers}
    for k in numbers:
        found[f"eta{k}_dot"] = f"-r{k}" + "".join(f" - d{k}{i}*a{i}" for i in _AXES)
    return found | ({f"h{i}": f"-T{i}" for i in _AXES} if wheels else {})


def _states(modes: int, *, wheels: bool) -> dict[str, Quantity]:
    numbers = range(1, modes + 1)
    found = {f"q{i}": Quantity("1", f"quaternion from body to inertial axes, vector part {i}") for i in _AXES}
    found["q4"] = Quantity("1", "quaternion from body to inertial axes, scalar part")
    found |= {f"w{i}": Quantity("rad/s", f"angular velocity about body axis {i}") for i in _AXES}
    found |= {f"eta{k}": Quantity("sqrt(kg) m", f"modal coordinate {k}") for k in numbers}
    found |= {f"eta{k}_dot": Quantity("sqrt(kg) m/s", f"rate of modal coordinate {k}") for k in numbers}
    if wheels:
        found |= {f"h{i}": Quantity("N m s", f"momentum of the wheel along body axis {i}") for i in _AXES}
    return found


def _variant(options: Mapping[str, Any]) -> LibraryModel:
    modes, wheels = int(options["modes"]), options["actuators"] == "wheels"
    dynamics = _dynamics(modes, wheels=wheels)
    source = "of the wheels on the body" if wheels else "on the body"
    return replace(
        _BARE,
        states=_states(modes, wheels=wheels),
        controls={f"T{i}": Quantity("N m", f"torque {source} along axis {i}") for i in _AXES},
        parameters=_parameters(modes),
        equations={
            "kind": "first_order",
            "states": list(dynamics),
            "controls": [f"T{i}" for i in _AXES],
            "definitions": _definitions(modes, wheels=wheels),
            "dynamics": dynamics,
        },
    )


_BARE = LibraryModel(
    name="attitude_flexible",
    title="Attitude in space: quaternion, full inertia, flexible modes, torques or wheels",
    source="P. W. Likins, JPL TR 32-1329, 1970; B. Wie, Space Vehicle Dynamics and Control, AIAA 2008",
    states={},
    controls={},
    parameters={},
    equations={},
    positive=("D11", "D2", "D3"),
    options={
        "modes": Option(2, tuple(range(MAX_MODES + 1)), "number of flexible modes"),
        "actuators": Option("torque", ("torque", "wheels"), "torque from outside, or three wheels"),
    },
    variant=_variant,
)
MODEL = _BARE.with_options({})
