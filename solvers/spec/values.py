"""Values and bounds of a document as numbers.

A *value* is a number or the text of an expression in parameters and constants; a *bound* is a value (equal
to), ``[lower, upper]`` with ``None`` for a side that is open, or ``None`` (free).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from solvers.errors import ExpressionError
from solvers.expressions import parse

Value = float | str
BoundValue = Value | Sequence[Value | None] | None
Interval = tuple[float, float]

FREE: Interval = (-math.inf, math.inf)


def is_finite(number: float) -> bool:
    """Tell whether a number fits in a double; an integer of any size may be asked about."""
    try:
        return math.isfinite(number)
    except OverflowError:
        return False


def evaluate_constant(value: Value, parameters: Mapping[str, float]) -> float:
    """Return the number that ``value`` stands for, given the values of the ``parameters``.

    Raises ExpressionError if the text is not an expression, uses a name that is not in ``parameters``, or
    has no finite real value.
    """
    if isinstance(value, str):
        expression = parse(value)
        for name in expression.undefined(parameters):
            raise ExpressionError(f"unknown name '{name}'", expression.positions[name])
        with np.errstate(all="ignore"):
            number = float(expression.evaluate(parameters))
        if math.isfinite(number):
            return number
    elif is_finite(value):
        return float(value)
    raise ExpressionError("the value is not a finite real number", 0)


def bound_interval(bound: BoundValue, parameters: Mapping[str, float]) -> Interval:
    """Return ``(lower, upper)`` of a bound, with ``-inf`` and ``inf`` for open sides.

    Raises ExpressionError as `evaluate_constant` does.
    """
    if bound is None:
        return FREE
    if isinstance(bound, str | int | float):
        number = evaluate_constant(bound, parameters)
        return number, number
    lower, upper = bound
    return (
        -math.inf if lower is None else evaluate_constant(lower, parameters),
        math.inf if upper is None else evaluate_constant(upper, parameters),
    )


def inside(interval: Interval) -> float:
    """Return a representative of an interval: its middle, or its value nearest to 0 if a side is open."""
    lower, upper = interval
    if math.isfinite(lower) and math.isfinite(upper):
        return lower / 2 + upper / 2
    return min(max(0.0, lower), upper)
