"""MathML says what the expression says: read back by a reader of its own and evaluated at random points."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.report.mathml import formula, name, number
from solvers.expressions import parse
from solvers.models import LIBRARY

CASES = sorted((Path(__file__).parents[3] / "solvers" / "cases").glob("*.json"))
ENTITIES = {"&times;": "*", "&minus;": "-", "&#x2062;": "*", "&#x2061;": ""}
FUNCTIONS = {"arcsin": "asin", "arccos": "acos", "arctan": "atan", "ln": "log", "sgn": "sign"}
CONSTANTS = {"π": "pi", "°": "deg", "rpm": "rpm"}


def tree_of(xml: str) -> ET.Element:
    for entity, text in ENTITIES.items():
        xml = xml.replace(entity, text)
    return ET.fromstring(f"<mrow>{xml}</mrow>")


def read(element: ET.Element, names: dict[str, str]) -> str:
    """The expression that a piece of MathML stands for; ``names``: pieces that are names, and these."""
    if (known := names.get(ET.tostring(element, encoding="unicode"))) is not None:
        return known
    parts = [read(child, names) for child in element]
    match element.tag:
        case "mfrac":
            return f"(({parts[0]})/({parts[1]}))"
        case "msup" if element[0].text == "e":
            return f"exp({parts[1]})"
        case "msup":
            return f"(({parts[0]})^({parts[1]}))"
        case "msqrt":
            return f"sqrt({''.join(parts)})"
        case "mrow" if parts and parts[0] == parts[-1] == "|":
            return f"abs({''.join(parts[1:-1])})"
        case "mrow":
            return "".join(parts)
        case "mn" | "mo" | "mi":
            text = element.text or ""
            return CONSTANTS.get(text, FUNCTIONS.get(text, text))
    raise AssertionError(element.tag)


def read_back(text: str) -> str:
    names = {ET.tostring(tree_of(name(each).xml)[0], encoding="unicode"): each for each in parse(text).names}
    assert len(names) == len(parse(text).names), "two names look the same"
    return read(tree_of(formula(text).xml), names)


def same(text: str) -> None:
    expression, again = parse(text), parse(read_back(text))
    values: dict[str, Any] = dict(
        zip(sorted(expression.names), np.random.default_rng(5).uniform(0.1, 0.9, (99, 4)), strict=False)
    )
    values |= {"Td": np.cos, "drag": np.exp}
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(again.evaluate(values), expression.evaluate(values), rtol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "-a^2",
        "(-a)^2",
        "a - (b - c)",
        "a - (b + c)*d",
        "a*-b",
        "a - -b",
        "-a*b + c",
        "a/b/c",
        "a/(b/c)",
        "(a/b)^2",
        "2^-1",
        "a^b^c",
        "(a^b)^c",
        "2*3*a*4",
        "sin(a)^2 + cos(a + b)*b",
        "exp(-a^2)^2/sqrt(a + 1)",
        "abs(a - b)*min(a, b, 2) - max(a, 1e-8*b)",
        "atan2(a, b) + asin(a)*log(b)",
        "30*deg + pi/6 - 2*rpm",
        "1.5e+20*a + 2e-3",
        "a*Td(t + b)^2 - drag(a)/2",
        "theta_dot^2*phi1 + lambda_f - t_max*tf",
    ],
)
def test_operators_and_functions(text: str) -> None:
    same(text)


def expressions(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from expressions(item)
    elif isinstance(value, list):
        for item in value:
            yield from expressions(item)


def test_every_expression_of_every_case_and_model() -> None:
    models = [json.loads(path.read_text())["problem"]["model"] for path in CASES]
    models += [model.document({}) for model in LIBRARY.values()]
    count = 0
    for model in models:
        parts = [
            model.get(key) for key in ("mass", "damping", "stiffness", "force", "dynamics", "definitions")
        ]
        for text in expressions(parts):
            same(text)
            count += 1
    assert count > 40


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("theta", "<mi>θ</mi>"),
        ("Omega", "<mi>Ω</mi>"),
        ("phi1", "<msub><mi>φ</mi><mn>1</mn></msub>"),
        ("x_max", "<msub><mi>x</mi><mi>max</mi></msub>"),
        ("root_moment", "<mi>root_moment</mi>"),
        ("q_ddot", '<mover accent="true"><mi>q</mi><mo>¨</mo></mover>'),
        ("x_f", "<msub><mi>x</mi><mi>f</mi></msub>"),
    ],
)
def test_names(text: str, shown: str) -> None:
    assert name(text).xml == shown


def test_numbers() -> None:
    assert number(440.0).xml == "<mn>440</mn>"
    assert re.sub("<.*?>", "", number(-1.5e-7).xml) == "&minus;1.5&times;10&minus;7"
