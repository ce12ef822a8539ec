"""What the methods of this version do not do with a problem: refused at the pointer of the key."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import Any

from solvers.errors import ExpressionError
from solvers.expressions import Code, Expression, parse
from solvers.spec.faults import Flaws, Path
from solvers.spec.scope import Scope, mapping
from solvers.spec.values import evaluate_constant

CORNERS = frozenset(("abs", "min", "max"))
_NOT_FLOWN = (
    "scenarios",
    "data",
    "design",
    "final_attitude",
    "integrals",
    "control_rates",
    "initial_control",
    "final_control",
)


def check_support(scope: Scope, flaws: Flaws) -> None:
    """Note every key that the method of the document cannot work with."""
    method = mapping(scope.document.get("method"))
    if method.get("refine") == "switching":
        for place, what in not_refined(scope):
            detail = f"unsupported: {what} with refine 'switching' is not in this version"
            flaws.add(detail, "problem", *place, type="unsupported")
    if method.get("name") == "piecewise":
        if mapping(scope.problem.get("objective")).get("maximum") is not None:
            detail = "unsupported: a maximum objective with this method is not in this version"
            flaws.add(detail, "problem", "objective", "maximum", type="unsupported")
        for place, what in _not_flown(scope.document):
            detail = f"unsupported: {what} with the method piecewise is not in this version"
            flaws.add(detail, *place, type="unsupported")


def _not_flown(document: dict[str, Any]) -> Iterator[tuple[Path, str]]:
    """Yield what missions in segments cannot work with: place in the document, and what it is."""
    problem = mapping(document.get("problem"))
    for key in _NOT_FLOWN:
        if problem.get(key):
            yield ("problem", key), f"'{key}'"
    for index in _windows(problem):
        yield ("problem", "path_constraints", index, "during"), "a window of a path constraint"
    for key in ("command", "coast"):
        if mapping(document.get("output")).get(key) is not None:
            yield ("output", key), f"'{key}'"
    if document.get("warm_start") is not None:
        yield ("warm_start",), "'warm_start'"
    if _worth(mapping(document.get("options")).get("starts", 1)) != 1:
        yield ("options", "starts"), "more than one start"


def _windows(problem: dict[str, Any]) -> Iterator[int]:
    """Yield the indices of the path constraints that hold during a part of the time."""
    constraints = problem.get("path_constraints")
    for index, item in enumerate(constraints if isinstance(constraints, list) else ()):
        during = mapping(item).get("during", [0, 1])
        if not isinstance(during, list) or [_worth(side) for side in during] != [0, 1]:
            yield index


def _worth(value: Any, parameters: Mapping[str, float] = MappingProxyType({})) -> float:
    """What a value is worth; NaN where that cannot be told."""
    try:
        return evaluate_constant(value, parameters)
    except (ExpressionError, TypeError):
        return math.nan


def uses_corners(expression: Any) -> bool:
    """Tell whether an expression takes abs, min or max of anything."""
    try:
        return not CORNERS.isdisjoint(
            payload for _, payload in parse(expression).program if type(payload) is str
        )
    except (ExpressionError, TypeError):
        return False  # reported where it stands


def _counts_magnitudes_only(scope: Scope, running: Expression) -> bool:
    """Whether all its corners are those of abs(u) for controls with room on both sides of 0.

    They are solved for as two sides, on which arcs rest, where one plant flies without phases.
    """
    if scope.problem.get("phases") or scope.problem.get("scenarios"):
        return False
    bounds, program = mapping(scope.problem.get("bounds")), running.program
    for (_, before), (code, payload) in pairwise(program):
        if code in (Code.CALL, Code.PAIR) and payload in CORNERS:
            sides = bounds.get(before) if payload == "abs" and before in scope.controls else None
            lower, upper = sides if isinstance(sides, list) and len(sides) == 2 else (0, 0)
            if not _worth(lower, scope.parameters) < 0 < _worth(upper, scope.parameters):
                return False
    return True


def not_refined(scope: Scope) -> Iterator[tuple[Path, str]]:
    """Yield what switching refinement cannot work with: place below the problem, and what it is."""
    problem = scope.problem
    for index in _windows(problem):
        yield ("path_constraints", index, "during"), "a window of a path constraint"
    running = mapping(problem.get("objective")).get("running")
    if uses_corners(running) and not _counts_magnitudes_only(scope, parse(running)):
        yield ("objective", "running"), "a running cost of abs, min or max, but for magnitudes of controls"
    for key in ("initial_control", "final_control"):
        for control in mapping(problem.get(key)):
            if control not in mapping(problem.get("control_rates")):
                yield (key, control), "a bound at an end on a control that may jump"
