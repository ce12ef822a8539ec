"""A checked expression as a flat postfix program, evaluated over any backend."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from solvers.expressions.vocabulary import NUMPY_FUNCTIONS


class Code(IntEnum):
    """What an instruction does to the stack; its payload is named behind it."""

    NAME = 0  # push the value of a name: the name
    NUMBER = 1  # push a number: a float
    OPERATOR = 2  # replace two values by one: a callable of two values
    NEGATE = 3  # change the sign: nothing
    CALL = 4  # apply a function of one argument: its name
    PAIR = 5  # apply a function of two arguments: its name
    LOOKUP = 6  # replace a value by what a data table gives for it: the name of the table


Instruction = tuple[Code, Any]


@dataclass(frozen=True, slots=True)
class Expression:
    """An expression that has been read and found well formed.

    Attributes
    ----------
    text:
        What was parsed.
    positions:
        Every name that it uses (constants excepted) -> where it first stands, in characters from 0.
    operations:
        Number of operators and function calls (``min`` of three arguments counts two).
    program:
        Instructions in postfix order.
    called:
        Those of its names that it calls: they must be data tables.
    """

    text: str
    positions: Mapping[str, int]
    operations: int
    program: tuple[Instruction, ...]
    called: frozenset[str] = frozenset()

    @property
    def names(self) -> frozenset[str]:
        """The names that need a value: everything but constants and functions."""
        return frozenset(self.positions)

    def undefined(self, scope: Container[str]) -> list[str]:
        """Return the names that are not in ``scope``, in the order in which they appear."""
        return [name for name in self.positions if name not in scope]

    def evaluate(
        self, values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]] = NUMPY_FUNCTIONS
    ) -> Any:
        """Return the value of the expression.

        ``values`` gives each name a float, a NumPy array (arrays broadcast) or a symbol of a computer
        algebra backend, each name that is called a callable, ``functions`` each function name a callable of
        one or two arguments over the same things. Floats follow IEEE 754: 1/0 is inf, (-8)^(1/3) is nan;
        nothing is ever complex. NumPy may warn of such operations: wrap the call in ``numpy.errstate`` to be
        rid of it.

        Raises KeyError for a name without a value.
        """
        stack: list[Any] = []
        push, pop = stack.append, stack.pop
        for code, payload in self.program:
            if code == 0:
                push(values[payload])
            elif code == 1:
                push(payload)
            elif code == 2:
                right = pop()
                stack[-1] = payload(stack[-1], right)
            elif code == 3:
                stack[-1] = -stack[-1]
            elif code == 4:
                stack[-1] = functions[payload](stack[-1])
            elif code == 5:
                right = pop()
                stack[-1] = functions[payload](stack[-1], right)
            else:
                stack[-1] = values[payload](stack[-1])
        return stack[0]


def divide(left: Any, right: Any) -> Any:
    """``left / right``; plain floats divide like IEEE 754 numbers instead of raising ZeroDivisionError."""
    if type(left) is float and type(right) is float:
        return np.float64(left) / right
    return left / right


def power(left: Any, right: Any) -> Any:
    """``left ** right``; plain floats give nan or inf where Python gives complex numbers or raises."""
    if type(left) is float and type(right) is float:
        return np.float64(left) ** right
    return left**right
