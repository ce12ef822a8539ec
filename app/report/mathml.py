"""Expressions of a document as MathML, which browsers draw by themselves.

Every operation of an expression is applied to `Formula`, which writes itself: what stands weaker than its
neighbours gets parentheses.
"""

from __future__ import annotations

import html
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from solvers.expressions import CONSTANTS, Code, Expression, parse

# How strongly a formula holds together.
SUM, PRODUCT, POWER, ATOM = 1, 2, 3, 4

_TIMES = '<mo rspace="0.17em">&#x2062;</mo>'  # said aloud, drawn as a thin space
_APPLY = "<mo>&#x2061;</mo>"
_FUNCTIONS = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "log": "ln", "sign": "sgn"}
_CONSTANTS = {CONSTANTS["pi"]: "π", CONSTANTS["deg"]: "°", CONSTANTS["rpm"]: "rpm"}
_DOTS = {"_dot": "˙", "_ddot": "¨"}
_NAME = re.compile(r"(?P<base>.+?)(?P<dots>_dot|_ddot)?(?P<end>_0|_f)?")
_PARTS = re.compile(r"(?P<stem>[A-Za-z]+?)(?:_(?P<rest>\w+)|(?P<digits>\d+))?")


@dataclass(frozen=True, slots=True)
class Formula:
    """A piece of MathML; ``negative`` if it begins with a minus sign."""

    xml: str
    strength: int = ATOM
    negative: bool = False

    def at_least(self, strength: int, *, first: bool = True) -> str:
        """The piece as an operand of something so strong; a leading minus may stand in the first one only."""
        if self.strength < strength or (self.negative and not first):
            return f"<mrow><mo>(</mo>{self.xml}<mo>)</mo></mrow>"
        return self.xml

    def __add__(self, other: Formula) -> Formula:
        return Formula(f"{self.xml}<mo>+</mo>{other.at_least(SUM, first=False)}", SUM, self.negative)

    def __sub__(self, other: Formula) -> Formula:
        return Formula(
            f"{self.xml}<mo>&minus;</mo>{other.at_least(PRODUCT, first=False)}", SUM, self.negative
        )

    def __mul__(self, other: Formula) -> Formula:
        right = other.at_least(PRODUCT, first=False)
        times = "<mo>&times;</mo>" if right.startswith("<mn>") else _TIMES
        return Formula(f"{self.at_least(PRODUCT)}{times}{right}", PRODUCT, self.negative)

    def __truediv__(self, other: Formula) -> Formula:
        return Formula(f"<mfrac><mrow>{self.xml}</mrow><mrow>{other.xml}</mrow></mfrac>", POWER)

    def __pow__(self, other: Formula) -> Formula:
        base = self.at_least(ATOM, first=False)
        return Formula(f"<msup><mrow>{base}</mrow><mrow>{other.xml}</mrow></msup>", POWER)

    def __neg__(self) -> Formula:
        minus = '<mo form="prefix">&minus;</mo>'
        return Formula(f"{minus}{self.at_least(PRODUCT, first=False)}", PRODUCT, True)


def formula(value: str | float) -> Formula:
    """The formula of an expression. Raises ExpressionError for what is none."""
    return of_expression(parse(value))


def of_expression(expression: Expression) -> Formula:
    """The formula of a parsed expression."""
    stack: list[Formula] = []
    for code, payload in expression.program:
        if code == Code.NAME:
            stack.append(name(payload))
        elif code == Code.NUMBER:
            stack.append(number(payload))
        elif code == Code.NEGATE:
            stack.append(-stack.pop())
        elif code == Code.CALL:
            stack.append(_call(payload, [stack.pop()]))
        elif code == Code.LOOKUP:
            stack.append(_called(name(payload).xml, [stack.pop()]))
        else:
            right, left = stack.pop(), stack.pop()
            # An operator is a callable of two values: here it is handed two formulas.
            stack.append(payload(left, right) if code == Code.OPERATOR else _call(payload, [left, right]))
    return stack[0]


def number(value: float) -> Formula:
    """A number, with its power of ten where it is long; a constant by its name."""
    if value in _CONSTANTS:
        return Formula(f'<mi mathvariant="normal">{_CONSTANTS[value]}</mi>')
    if value < 0:
        return -number(-value)
    digits, _, exponent = repr(value).partition("e")
    if not exponent:
        return Formula(f"<mn>{digits.removesuffix('.0')}</mn>")
    power = f"<msup><mn>10</mn><mrow>{number(int(exponent)).xml}</mrow></msup>"
    return Formula(f"<mn>{digits}</mn><mo>&times;</mo>{power}", PRODUCT)


def name(text: str) -> Formula:
    """A name: Greek letters by their sign, digits and what follows ``x_`` below, velocities with a dot."""
    match = _NAME.fullmatch("t_f" if text == "tf" else text)
    assert match is not None  # any text has a base
    xml = _letter(match["base"])
    if match["dots"]:
        xml = f'<mover accent="true">{xml}<mo>{_DOTS[match["dots"]]}</mo></mover>'
    if match["end"]:
        xml = f"<msub>{xml}{_identifier(match['end'][1:])}</msub>"
    return Formula(xml)


def equation(left: Formula, right: Formula, relation: str = "=") -> Markup:
    """A formula of its own line."""
    return _math(f"{left.xml}<mo>{relation}</mo>{right.xml}", ' display="block"')


def matrix(rows: Sequence[Sequence[str | float]]) -> Formula:
    """A matrix in brackets."""
    cells = "".join(
        "<mtr>" + "".join(f"<mtd>{formula(entry).xml}</mtd>" for entry in row) + "</mtr>" for row in rows
    )
    return Formula(f"<mrow><mo>[</mo><mtable>{cells}</mtable><mo>]</mo></mrow>")


def column(entries: Iterable[Formula]) -> Formula:
    """A column in brackets."""
    cells = "".join(f"<mtr><mtd>{entry.xml}</mtd></mtr>" for entry in entries)
    return Formula(f"<mrow><mo>[</mo><mtable>{cells}</mtable><mo>]</mo></mrow>")


def integral(integrand: Formula) -> Formula:
    """The integral from t0 to tf."""
    limits = f"<msubsup><mo>∫</mo>{name('t_0').xml}{name('t_f').xml}</msubsup>"
    return Formula(f"{limits}{integrand.at_least(PRODUCT)}{_TIMES}<mi>d</mi><mi>t</mi>", PRODUCT)


def inline(piece: Formula) -> Markup:
    """A formula in a line of text."""
    return _math(piece.xml)


def _math(xml: str, attributes: str = "") -> Markup:
    # Made of numbers and of names, which are escaped where they are written.
    return Markup(f"<math{attributes}>{xml}</math>")  # noqa: S704


def _call(function: str, arguments: Sequence[Formula]) -> Formula:
    first = arguments[0]
    if function == "sqrt":
        return Formula(f"<msqrt>{first.xml}</msqrt>")
    if function == "abs":
        return Formula(f"<mrow><mo>|</mo>{first.xml}<mo>|</mo></mrow>")
    if function == "exp":
        return Formula(f"<msup><mi>e</mi><mrow>{first.xml}</mrow></msup>", POWER)
    return _called(f"<mi>{_FUNCTIONS.get(function, function)}</mi>", arguments)


def _called(function: str, arguments: Sequence[Formula]) -> Formula:
    """A function, by its piece of MathML, with its arguments."""
    listed = "<mo>,</mo>".join(argument.xml for argument in arguments)
    return Formula(f"{function}{_APPLY}<mrow><mo>(</mo>{listed}<mo>)</mo></mrow>", POWER)


def _letter(text: str) -> str:
    match = _PARTS.fullmatch(text)
    if match is None or (match["rest"] and len(_greek(match["stem"])) > 1):
        return _identifier(text)
    stem, below = _identifier(match["stem"]), match["rest"] or match["digits"]
    return f"<msub>{stem}{_identifier(below)}</msub>" if below else stem


def _identifier(text: str) -> str:
    """A letter in italics, a word upright."""
    return f"<mn>{text}</mn>" if text.isdigit() else f"<mi>{html.escape(_greek(text))}</mi>"


def _greek(text: str) -> str:
    """The Greek letter of this name, or the text itself."""
    size = "CAPITAL" if text[0].isupper() else "SMALL"
    letter = "LAMDA" if text.lower() == "lambda" else text.upper()
    try:
        return unicodedata.lookup(f"GREEK {size} LETTER {letter}")
    except KeyError:
        return text
