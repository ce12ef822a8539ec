"""Text -> checked expression: a tokenizer and a Pratt parser that writes postfix code as it reads.

Nothing here can run what it reads: there are numbers, names, five operators and a list of functions, and
every other character is an error with its position.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from solvers.errors import ExpressionError
from solvers.expressions.expression import Code, Expression, Instruction, divide, power
from solvers.expressions.vocabulary import ARITY, CONSTANTS, FUNCTIONS, did_you_mean, quoted

MAX_CHARACTERS = 4096
MAX_DEPTH = 64
MAX_OPERATIONS = 2000


# What other languages call what is written so here.
_ELSEWHERE = {"ln": "log", "pow": "^"}


def unknown_function(name: str) -> str:
    """Return the sentence about a name that is called and is neither a function nor a data table."""
    meant = _ELSEWHERE.get(name)
    hint = f"; did you mean '{meant}'?" if meant else did_you_mean(name, sorted(FUNCTIONS))
    return f"unknown function {quoted(name)} (a product needs its '*'){hint}"


class ExpressionLimitError(ExpressionError):
    """A well-formed expression that is too long, too deep or has too many operations."""


_TOKEN = re.compile(
    r"[ \t\r\n]*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z][A-Za-z0-9_]*)|(?P<mark>\*\*|[-+*/^(),])|(?P<end>\Z)|(?P<other>.))",
    re.ASCII | re.DOTALL,
)
_Token = tuple[str, str, int]

_SUM, _PRODUCT, _SIGN, _POWER = 10, 20, 30, 40
_STRENGTH = {"+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "^": _POWER, "**": _POWER}
_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": divide,
    "^": power,
    "**": power,
}
# One shared instruction for each operator keeps cached programs small.
_APPLY: dict[str, Instruction] = {mark: (Code.OPERATOR, apply) for mark, apply in _OPERATORS.items()}
_NEGATE: Instruction = (Code.NEGATE, None)


def instruction(mark: str) -> Instruction:
    """Return what applies the operator ``mark`` to the two values on top of the stack."""
    return _APPLY[mark]


_REFUSALS = {
    ".": "attribute access is not part of an expression",
    "'": "text in quotes is not part of an expression",
    '"': "text in quotes is not part of an expression",
    "[": "brackets [] are not part of an expression; use ( )",
    "]": "brackets [] are not part of an expression; use ( )",
    **dict.fromkeys("<>=!", "comparisons and assignments are not part of an expression"),
    "_": "a name begins with a letter",
}


@lru_cache(maxsize=256)
def parse(text: str | float) -> Expression:
    """Return the expression that ``text`` stands for; a number stands for itself.

    Grammar: decimal numbers with or without exponent, names ``[A-Za-z][A-Za-z0-9_]*``, ``+ - * /``, ``^``
    or ``**`` (right associative, stronger than the sign: ``-a^2`` is ``-(a^2)``; ``2^-1`` is 1/2), unary
    minus, parentheses, calls of the known functions, and of data tables with one argument. At most 4,096
    characters, 64 levels deep, 2,000 operations.

    Raises ExpressionError with the position of what is wrong. Whether the names mean anything is for the
    caller to decide (`Expression.undefined`).
    """
    if isinstance(text, str):
        return _Parser(text).run()
    try:
        value = float(text)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise ExpressionError("a number must be finite (about 1.8e308 is the largest)", 0)
    return Expression(repr(value), {}, 0, ((Code.NUMBER, value),))


def _tokenize(text: str) -> list[_Token]:
    tokens: list[_Token] = []
    position = 0
    while True:
        match = _TOKEN.match(text, position)
        assert match is not None  # the last alternatives take every character and the end
        kind = str(match.lastgroup)
        start = match.start(kind)
        if kind == "other":
            character = match[kind]
            shown = f"the character {quoted(character)} is not part of an expression"
            raise ExpressionError(_REFUSALS.get(character, shown), start)
        tokens.append((kind, match[kind], start))
        if kind == "end":
            return tokens
        position = match.end()


class _Parser:
    """One pass over the tokens of one text; `run` may be called once."""

    def __init__(self, text: str) -> None:
        if len(text) > MAX_CHARACTERS:
            raise ExpressionLimitError(
                f"limit: an expression has at most {MAX_CHARACTERS:,} characters, this one has {len(text):,}",
                MAX_CHARACTERS,
            )
        self.text = text
        self.tokens = _tokenize(text)
        self.index = 0
        self.depth = 0
        self.operations = 0
        self.positions: dict[str, int] = {}
        self.program: list[Instruction] = []
        self.called: set[str] = set()

    def run(self) -> Expression:
        if self.tokens[0][0] == "end":
            raise ExpressionError("the expression is empty", 0)
        self.expression(0)
        kind, found, position = self.tokens[self.index]
        if found == ")":
            raise ExpressionError("')' without its '('", position)
        if found == ",":
            raise ExpressionError("',' separates arguments of a function; the decimal sign is '.'", position)
        if kind != "end":
            raise ExpressionError(f"an operator is missing before {quoted(found)}", position)
        return Expression(
            self.text, self.positions, self.operations, tuple(self.program), frozenset(self.called)
        )

    def expression(self, weakest: int) -> None:
        """Read operands joined by operators at least as strong as ``weakest``."""
        self.operand()
        while True:
            _, mark, position = self.tokens[self.index]
            strength = _STRENGTH.get(mark)
            if strength is None or strength < weakest:
                return
            self.index += 1
            if strength == _POWER:
                self.nested(_POWER, position)  # right associative: a^b^c goes one level deeper
            else:
                self.expression(strength + 1)
            self.emit(_APPLY[mark], position)

    def nested(self, weakest: int, position: int) -> None:
        """Read an expression one level deeper."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise ExpressionLimitError(f"limit: an expression is at most {MAX_DEPTH} levels deep", position)
        self.expression(weakest)
        self.depth -= 1

    def operand(self) -> None:
        kind, found, position = self.tokens[self.index]
        self.index += 1
        if kind == "number":
            value = float(found)
            if math.isinf(value):
                raise ExpressionError("the number is too large (about 1.8e308 is the largest)", position)
            self.program.append((Code.NUMBER, value))
        elif kind == "name":
            self.name(found, position)
        elif found == "-":
            self.nested(_SIGN, position)
            self.emit(_NEGATE, position)
        elif found == "(":
            self.nested(0, position)
            self.close(position)
        elif found == "+":
            raise ExpressionError("a '+' needs a value on its left; leave the sign out", position)
        elif kind == "end":
            raise ExpressionError("the expression ends where a value is expected", position)
        else:
            raise ExpressionError(f"a value is expected before {quoted(found)}", position)

    def name(self, name: str, position: int) -> None:
        called = self.tokens[self.index][1] == "("
        if name in FUNCTIONS:
            if not called:
                raise ExpressionError(f"the function {quoted(name)} needs its arguments in ( )", position)
            self.call(name, position)
        elif called:
            self.lookup(name, position)
        elif name in CONSTANTS:
            self.program.append((Code.NUMBER, CONSTANTS[name]))
        else:
            self.positions.setdefault(name, position)
            self.program.append((Code.NAME, name))

    def lookup(self, name: str, position: int) -> None:
        """Read the call of what can only be a data table; whether there is one is for the caller to say."""
        bracket = self.tokens[self.index][2]
        self.index += 1
        self.nested(0, position)
        if self.tokens[self.index][1] == ",":
            detail = f"{unknown_function(name)}; if it is a data table, it takes 1 argument"
            raise ExpressionError(detail, position)
        self.close(bracket)
        self.positions.setdefault(name, position)
        self.called.add(name)
        self.emit((Code.LOOKUP, name), position)

    def call(self, name: str, position: int) -> None:
        least, most = ARITY[name]
        bracket = self.tokens[self.index][2]
        count = 0
        while count == 0 or self.tokens[self.index][1] == ",":
            self.index += 1  # past '(' or ','
            if count == 0 and self.tokens[self.index][1] == ")":
                break
            self.nested(0, position)
            count += 1
            if count >= 2:  # min and max of many are taken two at a time
                self.emit((Code.PAIR, name), position)
        self.close(bracket)
        if count < least or (most is not None and count > most):
            wanted = f"{least}" if least == most else f"{least} or more"
            noun = "argument" if wanted == "1" else "arguments"
            raise ExpressionError(f"{quoted(name)} takes {wanted} {noun}, not {count}", position)
        if most == 1:
            self.emit((Code.CALL, name), position)

    def close(self, opened: int) -> None:
        kind, found, position = self.tokens[self.index]
        if kind == "end":
            raise ExpressionError("this '(' is never closed", opened)
        if found != ")":
            what = "an operator or ')' is missing" if found != "," else "')' is missing"
            raise ExpressionError(f"{what} before {quoted(found)}", position)
        self.index += 1

    def emit(self, instruction: Instruction, position: int) -> None:
        self.program.append(instruction)
        self.operations += 1
        if self.operations > MAX_OPERATIONS:
            raise ExpressionLimitError(
                f"limit: an expression has at most {MAX_OPERATIONS:,} operations", position
            )
