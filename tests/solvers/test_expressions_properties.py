"""What holds of every expression: written down and read again it is the same, and garbage is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from solvers.errors import ExpressionError
from solvers.expressions import NUMPY_FUNCTIONS, parse

# A tree is a number, a name, or (operator, operands...); it is evaluated here by plain recursion.
Tree = Any
NAMES = ("x", "y_1", "theta_dot", "E")
UNARY = ("sin", "cos", "tanh", "exp", "abs", "sqrt", "sign", "atan")
STRENGTH = {"+": 1, "-": 1, "*": 2, "/": 2, "neg": 3, "^": 4}

leaves = st.one_of(
    st.floats(0, 1e6, allow_nan=False), st.integers(0, 1000).map(float), st.sampled_from(NAMES)
)
trees = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.tuples(st.sampled_from("+-*/^"), inner, inner),
        st.tuples(st.just("neg"), inner),
        st.tuples(st.sampled_from(UNARY), inner),
        st.tuples(st.sampled_from(["min", "max", "atan2"]), inner, inner),
        st.tuples(st.sampled_from(["min", "max"]), inner, inner, inner),
    ),
    max_leaves=25,
)
values = st.fixed_dictionaries({name: st.floats(-100, 100) for name in NAMES})


def value_of(tree: Tree, names: dict[str, float]) -> np.float64:
    if isinstance(tree, float):
        return np.float64(tree)
    if isinstance(tree, str):
        return np.float64(names[tree])
    operator, *operands = tree
    numbers = [value_of(operand, names) for operand in operands]
    if operator == "neg":
        return -numbers[0]
    if operator in STRENGTH:
        left, right = numbers
        return {
            "+": lambda: left + right,
            "-": lambda: left - right,
            "*": lambda: left * right,
            "/": lambda: left / right,
            "^": lambda: left**right,
        }[operator]()
    result = numbers[0] if len(numbers) > 1 else NUMPY_FUNCTIONS[operator](numbers[0])
    for number in numbers[1:]:
        result = NUMPY_FUNCTIONS[operator](result, number)
    return np.float64(result)


def full_text(tree: Tree) -> str:
    """Return the tree with every operation in parentheses."""
    if isinstance(tree, float):
        return repr(tree)
    if isinstance(tree, str):
        return tree
    operator, *operands = tree
    texts = [full_text(operand) for operand in operands]
    if operator == "neg":
        return f"(-{texts[0]})"
    if operator in STRENGTH:
        return f"({texts[0]} {operator} {texts[1]})"
    return f"{operator}({', '.join(texts)})"


def short_text(tree: Tree, weakest: int = 0) -> str:
    """Return the tree with as few parentheses as the grammar needs."""
    if isinstance(tree, float | str):
        return full_text(tree)
    operator, *operands = tree
    if operator not in STRENGTH:
        return f"{operator}({','.join(short_text(operand) for operand in operands)})"
    strength = STRENGTH[operator]
    if operator == "neg":
        text = f"-{short_text(operands[0], strength)}"
    elif operator == "^":
        # The base must be stronger than a power; the exponent may be a power or a sign.
        text = f"{short_text(operands[0], strength + 1)}**{short_text(operands[1], STRENGTH['neg'])}"
    else:
        text = f"{short_text(operands[0], strength)}{operator}{short_text(operands[1], strength + 1)}"
    return f"({text})" if strength < weakest else text


def same(left: float, right: float) -> bool:
    return (math.isnan(left) and math.isnan(right)) or left == right


@settings(deadline=None)
@given(tree=trees, names=values)
def test_written_and_read_again_is_the_same(tree: Tree, names: dict[str, float]) -> None:
    with np.errstate(all="ignore"):
        wanted = value_of(tree, names)
        for text in (full_text(tree), short_text(tree)):
            assert same(float(parse(text).evaluate(names)), float(wanted)), text


@settings(deadline=None)
@given(text=st.text(max_size=60))
@example("\ud800")
@example("((((" * 30)
@example("1e99999999999")
def test_any_text_is_read_or_refused(text: str) -> None:
    read_or_refused(text)


@settings(max_examples=300, deadline=None)
@given(
    pieces=st.lists(
        st.sampled_from(
            [
                "x",
                "2",
                ".5",
                "1e3",
                "e",
                "+",
                "-",
                "*",
                "/",
                "^",
                "**",
                "(",
                ")",
                ",",
                "sin",
                "min",
                "pi",
                " ",
                ".",
            ]
        ),
        max_size=30,
    )
)
def test_any_row_of_tokens_is_read_or_refused(pieces: list[str]) -> None:
    read_or_refused("".join(pieces))


def read_or_refused(text: str) -> None:
    refusal: ExpressionError | None = None
    try:
        expression = parse(text)
    except ExpressionError as error:
        refusal = error
    if refusal is None:
        with np.errstate(all="ignore"):
            assert isinstance(expression.evaluate(dict.fromkeys(expression.names, 1.5)), float)
    else:
        assert 0 <= refusal.position <= len(text)
        assert refusal.detail.encode()
