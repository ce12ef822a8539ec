"""The grammar of expressions, value by value against numbers worked out by hand, and what it refuses."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from solvers.errors import ExpressionError
from solvers.expressions import (
    FUNCTIONS,
    MAX_CHARACTERS,
    MAX_DEPTH,
    MAX_OPERATIONS,
    NUMPY_FUNCTIONS,
    ExpressionLimitError,
    did_you_mean,
    parse,
    quoted,
)

VALUES = {"x": 2.0, "y": 5.0, "alpha_dot": 0.25, "e1": 7.0}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        # numbers
        ("7", 7),
        ("2.5", 2.5),
        (".5", 0.5),
        ("5.", 5),
        ("1e3", 1000),
        ("1E-2", 0.01),
        ("2.5e+1", 25),
        ("007", 7),
        ("1e-400", 0),
        # sums and products associate to the left
        ("10 - 3 - 2", 5),
        ("10 - 3 + 2", 9),
        ("16/4/2", 2),
        ("16/4*2", 8),
        ("2 + 3*4", 14),
        ("(2 + 3)*4", 20),
        # powers associate to the right and bind more strongly than the sign
        ("2^3^2", 512),
        ("2**3**2", 512),
        ("2^3**2", 512),
        ("(2^3)^2", 64),
        ("-2^2", -4),
        ("(-2)^2", 4),
        ("2^-1", 0.5),
        ("2^-2^2", 1 / 16),
        ("-2^-2", -0.25),
        ("2*3^2", 18),
        ("-x^2*3", -12),
        # signs
        ("--3", 3),
        ("---3", -3),
        ("2*-3", -6),
        ("2 - -3", 5),
        ("-2*-3", 6),
        ("-2 + 3", 1),
        # names, constants, white space
        ("x*y", 10),
        ("alpha_dot", 0.25),
        ("e1", 7),
        ("2*e1", 14),
        ("pi", math.pi),
        ("180*deg", math.pi),
        ("30*rpm", math.pi),
        (" \t\n x\r\n+ 1 ", 3),
        # functions
        ("sin(pi/6)", 0.5),
        ("cos(0)", 1),
        ("tan(pi/4)", 1),
        ("asin(1)", math.pi / 2),
        ("acos(1)", 0),
        ("atan(1)", math.pi / 4),
        ("atan2(1, -1)", 3 * math.pi / 4),
        ("atan2(-1, -1)", -3 * math.pi / 4),
        ("sinh(0)", 0),
        ("cosh(0)", 1),
        ("tanh(0)", 0),
        ("exp(0)", 1),
        ("log(exp(3))", 3),
        ("sqrt(16)", 4),
        ("abs(-3)", 3),
        ("sign(-3)", -1),
        ("sign(0)", 0),
        ("min(3, 1)", 1),
        ("min(3, 1, 2)", 1),
        ("max(1, 2, 3, 2)", 3),
        ("max(min(x, y), 1) + 1", 3),
        ("-sin(pi/2)^2", -1),
        ("2^sqrt(4)", 4),
    ],
)
def test_value(text: str, value: float) -> None:
    assert parse(text).evaluate(VALUES) == pytest.approx(value, rel=1e-15, abs=1e-15)


@pytest.mark.parametrize(
    ("text", "position", "word"),
    [
        ("", 0, "empty"),
        ("   ", 0, "empty"),
        ("x.y", 1, "attribute"),
        ("(1).real", 3, "attribute"),
        ("x[0]", 1, "brackets"),
        ("foo(1, 2)", 0, "unknown function 'foo'"),
        ("sinn(1, x)", 0, "did you mean 'sin'"),
        ("x()", 2, "value is expected"),
        ("x(2", 1, "never closed"),
        ("__import__('os')", 0, "letter"),
        ("x < 1", 2, "comparisons"),
        ("x == 1", 2, "comparisons"),
        ("x = 1", 2, "assignments"),
        ("'x'", 0, "quotes"),
        ('"x"', 0, "quotes"),
        ("lambda: x", 6, "':'"),
        ("lambda x", 7, "operator is missing"),
        ("x if y else 1", 2, "operator is missing"),
        ("x; y", 1, "';'"),
        ("2x", 1, "operator is missing before 'x'"),
        ("2 3", 2, "operator is missing"),
        ("(x)(y)", 3, "operator is missing"),
        ("1..2", 2, "operator is missing"),
        ("1_000", 1, "letter"),
        ("0x10", 1, "operator is missing"),
        ("1e", 1, "operator is missing"),
        ("1e400", 0, "too large"),
        ("1e400*0", 0, "too large"),
        ("x +", 3, "value is expected"),
        ("x * / y", 4, "value is expected"),
        ("+x", 0, "'+'"),
        ("x + + y", 4, "'+'"),
        ("(x", 0, "never closed"),
        ("sin(x", 3, "never closed"),
        ("x)", 1, "without its '('"),
        ("()", 1, "value is expected"),
        ("1,5", 1, "decimal"),
        ("(1, 5)", 2, "')' is missing"),
        ("(1 5)", 3, "')' is missing"),
        ("sin", 0, "arguments in ( )"),
        ("sin + 1", 0, "arguments in ( )"),
        ("sin()", 0, "1 argument, not 0"),
        ("sin(1, 2)", 0, "1 argument, not 2"),
        ("sin(1,)", 6, "value is expected"),
        ("atan2(1)", 0, "2 arguments, not 1"),
        ("atan2(1, 2, 3)", 0, "2 arguments, not 3"),
        ("min(1)", 0, "2 or more arguments, not 1"),
        ("max()", 0, "2 or more arguments, not 0"),
        ("sin x", 0, "arguments in ( )"),
        ("2*µ", 2, "'µ'"),
        ("\uff11", 0, "not part of an expression"),
        ("x\x00", 1, "not part of an expression"),
        ("x\u2028+1", 1, "not part of an expression"),
        ("x # 1", 2, "'#'"),
        ("x // y", 3, "value is expected"),
        ("x % y", 2, "'%'"),
        ("x @ y", 2, "'@'"),
        ("x ** ** y", 5, "value is expected"),
    ],
)
def test_refused_with_position(text: str, position: int, word: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse(text)
    assert caught.value.position == position
    assert word in caught.value.detail
    assert f"(at character {position + 1})" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("-" * 100_000 + "1", "4,096 characters"),
        ("1" * 5000, "4,096 characters"),
        ("x" + "+x" * 200_000, "4,096 characters"),
        ("-" * 4000 + "1", "64 levels"),
        ("(" * 2000 + "1" + ")" * 2000, "64 levels"),
        ("sin(" * 65 + "1" + ")" * 65, "64 levels"),
        ("2" + "^2" * 65, "64 levels"),
        ("min(" * 65 + "1", "64 levels"),
        ("1" + "+1" * 2001, "2,000 operations"),
        ("max(" + "1," * 2020 + "1)", "2,000 operations"),
    ],
)
def test_limits_are_refused_quickly(text: str, word: str) -> None:
    start = time.process_time()
    with pytest.raises(ExpressionLimitError, match=word):
        parse(text)
    assert time.process_time() - start < 0.5


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("(" * MAX_DEPTH + "1" + ")" * MAX_DEPTH, 1),
        ("-" * MAX_DEPTH + "1", 1),
        ("1" + "^1" * MAX_DEPTH, 1),
        ("1" + "+1" * MAX_OPERATIONS, MAX_OPERATIONS + 1),
        (" " * (MAX_CHARACTERS - 1) + "1", 1),
    ],
)
def test_limits_themselves_are_allowed(text: str, value: float) -> None:
    assert parse(text).evaluate({}) == value


@pytest.mark.parametrize("number", [10**400, math.inf, -math.inf, math.nan])
def test_number_that_is_not_finite_is_refused(number: float) -> None:
    with pytest.raises(ExpressionError, match="finite"):
        parse(number)


def test_number_stands_for_itself() -> None:
    assert parse(-2.5).evaluate({}) == -2.5
    assert parse(3).evaluate({}) == 3.0
    assert parse(3).names == frozenset()


@pytest.mark.parametrize(
    ("text", "check"),
    [
        ("1/0", lambda v: v == math.inf),
        ("-1/0", lambda v: v == -math.inf),
        ("0/0", math.isnan),
        ("(-8)^(1/3)", math.isnan),
        ("0^-1", lambda v: v == math.inf),
        ("10^1000", lambda v: v == math.inf),
        ("log(-1)", math.isnan),
        ("sqrt(-1)", math.isnan),
        ("exp(1000)", lambda v: v == math.inf),
        ("x/(x - x)", lambda v: v == math.inf),
        ("(x - 3)^0.5", math.isnan),
    ],
)
def test_floats_follow_ieee_and_are_never_complex(text: str, check: object) -> None:
    with np.errstate(all="ignore"):
        value = parse(text).evaluate(VALUES)
    assert isinstance(value, float)
    assert callable(check)
    assert check(value)


def test_arrays_broadcast() -> None:
    x, y = np.array([[1.0], [2.0]]), np.array([3.0, 4.0, 5.0])
    value = parse("max(x, y - 3) + x^2/2").evaluate({"x": x, "y": y})
    assert value.shape == (2, 3)
    np.testing.assert_allclose(value, np.maximum(x, y - 3) + x**2 / 2, rtol=1e-15)


def test_any_backend_with_operators_serves() -> None:
    class Text(str):
        """Writes down what is asked of it."""

        def __mul__(self, other: object) -> Text:  # type: ignore[override]
            return Text(f"({self}*{other})")

        def __neg__(self) -> Text:
            return Text(f"(-{self})")

    functions = {"sin": lambda a: Text(f"sin<{a}>"), "min": lambda a, b: Text(f"min<{a},{b}>")}
    written = parse("-sin(a)*min(a, b, a)").evaluate({"a": Text("A"), "b": Text("B")}, functions)
    assert written == "((-sin<A>)*min<min<A,B>,A>)"


def test_every_function_has_a_numpy_form() -> None:
    assert set(NUMPY_FUNCTIONS) == FUNCTIONS


def test_names_positions_and_operations() -> None:
    expression = parse("b*sin(a) + a^2 - pi*min(c, 1, b)")
    assert expression.names == {"a", "b", "c"}
    assert expression.positions == {"b": 0, "a": 6, "c": 24}
    assert expression.operations == 8
    assert expression.undefined({"a"}) == ["b", "c"]
    assert expression.undefined({"a", "b", "c"}) == []


def test_name_without_value_is_an_error() -> None:
    with pytest.raises(KeyError, match="y"):
        parse("x + y").evaluate({"x": 1.0})


@pytest.mark.parametrize(
    ("word", "candidates", "answer"),
    [
        ("Jc", ["Jb", "R", "m"], "; did you mean 'Jb'?"),
        ("jb", ["Jb", "jx"], "; did you mean 'Jb'?"),
        ("zzz", ["Jb", "R"], ""),
        ("theta_dto", ["theta", "theta_dot"], "; did you mean 'theta_dot'?"),
        ("x" * 1000, ["x" * 999], ""),
        ("a", [], ""),
    ],
)
def test_suggestion(word: str, candidates: list[str], answer: str) -> None:
    assert did_you_mean(word, candidates) == answer


def test_quoted_words_are_short_and_printable() -> None:
    assert quoted("a\x00b\nc") == "'a?b?c'"
    assert len(quoted("x" * 10_000)) < 70
