"""SymPy expressions as text of the expression language.

SymPy (the extra ``sympy``) is imported where an expression of it is written: whoever has one has it.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from solvers.expressions import parse

_DOTS = {1: "_dot", 2: "_ddot"}


def is_sympy(value: Any) -> bool:
    """Whether this is an expression, number or matrix of SymPy."""
    return hasattr(value, "free_symbols")


def sympy_text(expression: Any) -> str:
    """The text of a SymPy expression, numbers with all digits of a double.

    A function of t, a dynamic symbol ``theta(t)``, is written by its name, ``theta``, its derivatives
    ``theta_dot`` and ``theta_ddot``; any other undefined function of one argument is a data table. Raises
    ExpressionError for what the language has no word for.
    """
    text = str(_printer().doprint(expression))
    parse(text)
    return text


@cache
def _printer() -> Any:
    from sympy.printing.str import StrPrinter

    class Printer(StrPrinter):  # type: ignore[misc]
        """Writes the words of our language where they differ from SymPy's."""

        def _print_Float(self, node: Any) -> str:
            return repr(float(node))

        def _print_Exp1(self, node: Any) -> str:
            return "exp(1)"

        def _print_Abs(self, node: Any) -> str:
            return f"abs({self._print(node.args[0])})"

        def _print_Max(self, node: Any) -> str:
            return f"max({self.stringify(node.args, ', ')})"

        def _print_Min(self, node: Any) -> str:
            return f"min({self.stringify(node.args, ', ')})"

        def _print_Derivative(self, node: Any) -> str:
            order = sum(count for _, count in node.variable_count)
            if not self._is_dynamic(node.expr) or order not in _DOTS:
                return str(super()._print_Derivative(node))
            return f"{node.expr.func.__name__}{_DOTS[order]}"

        def _print_Function(self, node: Any) -> str:
            return str(node.func.__name__ if self._is_dynamic(node) else super()._print_Function(node))

        @staticmethod
        def _is_dynamic(node: Any) -> bool:
            from sympy.core.function import AppliedUndef

            return isinstance(node, AppliedUndef) and [str(argument) for argument in node.args] == ["t"]

    return Printer()
