"""The end of a turn in space: three equations of the error quaternion.

With unit quaternions q and t (scalar last) the product of q and the conjugate of t has the vector part
sin(angle/2) times the axis of the turn from t to q. It is 0 for q = t and for q = -t, which are one attitude.
The fourth equation, the unit norm, holds by itself, for the kinematics keep the norm: as an equation of its
own it would be one too many.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from solvers.expressions import parse
from solvers.formulation.quantities import Constraint, Interval
from solvers.spec import ProblemSpec, evaluate_constant, inside
from solvers.spec.attitude import QUATERNION

_POINTER = "/problem/final_attitude"


def attitude_constraints(spec: ProblemSpec, parameters: dict[str, float]) -> tuple[Constraint, ...]:
    """The three end conditions of ``final_attitude``; none where there is no such key."""
    target = _target(spec, parameters)
    if target is None:
        return ()
    *vector, scalar = (f"({value!r})" for value in target)
    found = []
    for index in range(3):
        after, before = (index + 1) % 3, (index + 2) % 3
        text = (
            f"{scalar}*q{index + 1}_f - {vector[index]}*q4_f"
            f" - {vector[before]}*q{after + 1}_f + {vector[after]}*q{before + 1}_f"
        )
        found.append(Constraint(f"final_attitude/{index}", _POINTER, parse(text), (0.0, 0.0), scale=1.0))
    return tuple(found)


def guessed_attitude(
    spec: ProblemSpec,
    parameters: dict[str, float],
    initial: Sequence[Interval],
    final: tuple[Interval, ...],
) -> tuple[Interval, ...]:
    """The final state for a guess: the target with the sign that is nearer to the start."""
    target = _target(spec, parameters)
    if target is None:
        return final
    places = [spec.model.states.index(name) for name in QUATERNION]
    nearness = sum(inside(initial[place]) * value for place, value in zip(places, target, strict=True))
    sign = -1.0 if nearness < 0.0 else 1.0
    ends = dict(zip(places, (sign * value for value in target), strict=True))
    return tuple((ends[i], ends[i]) if i in ends else interval for i, interval in enumerate(final))


def _target(spec: ProblemSpec, parameters: dict[str, float]) -> tuple[float, ...] | None:
    """The unit quaternion at the end."""
    if spec.final_attitude is None:
        return None
    values = [evaluate_constant(value, parameters) for value in spec.final_attitude]
    size = math.hypot(*values)
    return tuple(value / size for value in values)
