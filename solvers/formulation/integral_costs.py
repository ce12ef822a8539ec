"""What integrals count for at the end: whether more of one is anywhere asked for, and what it costs there."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from solvers.backends import NUMPY
from solvers.expressions import Code, Expression, combined, named, operands_of, parse, product, total
from solvers.expressions.expression import divide
from solvers.formulation.quantities import Constraint, Integral, Interval, Total

Held = tuple[Expression, Interval]
"""What is said at the end: an expression, and the interval in which it must be."""

_MARKS = {operator.add: "+", operator.sub: "-", operator.mul: "*", divide: "/"}


def said_at_the_ends(boundary: Iterable[Constraint], terminal_cost: Expression | None) -> Iterator[Held]:
    """Yield what boundary constraints hold; a cost is held from above."""
    yield from ((item.expression, item.interval) for item in boundary)
    if terminal_cost is not None:
        yield terminal_cost, (-np.inf, 0.0)


def held_integral(item: Integral | Total) -> Held:
    """An integral, and the interval in which it is held."""
    return named(item.name), item.interval


def exact_integrals(
    integrals: Iterable[Integral | Total], held: Sequence[Held], parameters: Mapping[str, float]
) -> frozenset[str]:
    """The integrals that may not be more than they are: more of one is somewhere better, or nobody knows."""

    def never_better(name: str, expression: Expression, interval: Interval) -> bool:
        if name not in expression.names:
            return True
        factor = multiple_of(expression, name, parameters)
        slope = None if factor is None else constant(factor, parameters)
        if slope is None:
            return False
        return interval[0] == -np.inf if slope > 0.0 else interval[1] == np.inf

    names = [item.name for item in integrals]
    return frozenset(name for name in names if not all(never_better(name, *item) for item in held))


def multiple_of(expression: Expression, name: str, parameters: Mapping[str, float]) -> Expression | None:
    """What a name is multiplied by in a sum of multiples by numbers and parameters; None in anything else."""
    factor, found = parse(1.0), list[Expression]()
    # A long sum is a deep tree on its left: it is walked down, not called down.
    while name in expression.names:
        (code, payload), operands = operands_of(expression)
        mark = _MARKS.get(payload, "") if code == Code.OPERATOR else ""
        if code == Code.NAME:
            found.append(factor)
            break
        if code == Code.NEGATE:
            factor, expression = product(parse(-1.0), factor), operands[0]
        elif mark in ("+", "-"):
            right = multiple_of(operands[1], name, parameters)
            if right is None:
                return None
            found.append(product(parse(1.0 if mark == "+" else -1.0), factor, right))
            expression = operands[0]
        elif mark and constant(operands[1], parameters) is not None:
            factor, expression = combined(mark, factor, operands[1]), operands[0]
        elif mark == "*" and constant(operands[0], parameters) is not None:
            factor, expression = product(factor, operands[0]), operands[1]
        else:
            return None
    return total(found)


def constant(expression: Expression, parameters: Mapping[str, float]) -> float | None:
    """What is made of numbers and parameters only is worth, if that is finite and not zero."""
    if not expression.names <= parameters.keys():
        return None
    with np.errstate(all="ignore"):
        value = float(expression.evaluate(parameters, NUMPY.functions))
    return value if np.isfinite(value) and value != 0.0 else None
