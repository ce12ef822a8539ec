"""Where the attitude ends: a quaternion, held by three equations so that both of its signs will do."""

from __future__ import annotations

import math
from typing import Any

from solvers.expressions import quoted
from solvers.spec.checks import check_constant
from solvers.spec.faults import Flaws, refuse
from solvers.spec.fields import VALUE_SCHEMA, Check
from solvers.spec.scope import Scope, mapping
from solvers.spec.tables import list_of

QUATERNION = ("q1", "q2", "q3", "q4")
"""The states of a model that turns in space: the scalar part comes last."""

# A quaternion that somebody has printed and read again.
_UNIT = 1e-6


class TargetQuaternion(Check):
    """Four values that are not all 0, for a model with the states q1 to q4."""

    def check(self, value: Any, scope: Scope) -> list[Any]:
        """Return the values as submitted."""
        values, flaws = list_of(value), Flaws()
        if len(values) != 4:
            raise refuse(f"a quaternion has 4 values, scalar part last, not {len(values)}")
        if scope.known and not set(QUATERNION) <= set(scope.states):
            raise refuse(
                "the model has no states q1, q2, q3, q4 (scalar part last), as that of the library "
                "'attitude_flexible' has"
            )
        numbers = [check_constant(item, scope, flaws, index) for index, item in enumerate(values)]
        if all(number == 0.0 for number in numbers):
            flaws.add("a quaternion is not 0")
        flaws.raise_any()
        return values

    def schema(self) -> dict[str, Any]:
        """Four values."""
        return {"type": "array", "items": VALUE_SCHEMA, "minItems": 4, "maxItems": 4}


def check_attitude(scope: Scope, flaws: Flaws) -> None:
    """The attitude begins with a unit quaternion, and its end is given once."""
    if scope.problem.get("final_attitude") is None or not set(QUATERNION) <= set(scope.states):
        return
    initial, final = (mapping(scope.problem.get(key)) for key in ("initial_state", "final_state"))
    for name in ("*", *QUATERNION):
        if name in final:
            detail = f"{quoted(name)} would hold the attitude twice: final_attitude says where it ends"
            flaws.add(detail, "problem", "final_state", name)
    values = [initial.get(name, initial.get("*")) for name in QUATERNION]
    numbers = [
        None if value is None or isinstance(value, list) else check_constant(value, scope, Flaws())
        for value in values
    ]
    if None not in numbers:
        size = math.hypot(*(number for number in numbers if number is not None))
        if abs(size - 1.0) > _UNIT:
            flaws.add(
                f"q1 to q4 are a unit quaternion, not one of norm {size:.6g}", "problem", "initial_state"
            )
