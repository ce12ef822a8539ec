"""How one value, expression or bound of a document is checked against the names in its scope.

Each function notes what is wrong in ``flaws``, at ``path`` below the field that is being checked.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, TypeGuard

from solvers.errors import ExpressionError
from solvers.expressions import (
    CONSTANTS,
    Code,
    Expression,
    ExpressionLimitError,
    parse,
    quoted,
    unknown_function,
)
from solvers.spec.faults import Flaws, Path, kind_of
from solvers.spec.scope import Scope
from solvers.spec.values import FREE, Interval, evaluate_constant, is_finite

_NUMBERS = (int, float)  # a union would be made anew at every call
MAX_EXPANDED = 100_000
"""The largest number of operations of an expression with all definitions written out."""


def check_expression(
    value: Any,
    place: str,
    scope: Scope,
    flaws: Flaws,
    *path: str | int,
    without: Collection[str] = (),
) -> None:
    """Check a number or expression that may use the names of ``place``: constant, model, path, boundary.

    ``without``: definitions that come too late for it.
    """
    if is_number(value):
        _check_number(value, flaws, path)
        return
    if not isinstance(value, str):
        flaws.add(f"must be a number or an expression, not {kind_of(value)}", *path)
        return
    try:
        expression = parse(value)
    except ExpressionError as error:
        flaws.add(str(error), *path, type="limit" if isinstance(error, ExpressionLimitError) else "invalid")
        return
    if scope.known or place == "constant":
        _check_names(expression, place, scope, flaws, path, without)
        if expression.called or scope.table_names:
            _check_calls(expression, scope, flaws, path)
        size = scope.expanded(expression) if scope.definition_sizes else 0
        if size > MAX_EXPANDED:
            detail = f"limit: {size:,} operations with definitions written out, at most {MAX_EXPANDED:,}"
            flaws.add(detail, *path, type="limit")


def is_number(value: Any) -> TypeGuard[float]:
    """Tell whether a value is a number; true and false are not."""
    return isinstance(value, _NUMBERS) and not isinstance(value, bool)


def _check_number(value: float, flaws: Flaws, path: Path) -> bool:
    if is_finite(value):
        return True
    flaws.add("a number must be finite (about 1.8e308 is the largest)", *path)
    return False


def _check_names(
    expression: Expression, place: str, scope: Scope, flaws: Flaws, path: Path, without: Collection[str]
) -> None:
    names = scope.names(place)
    if without:
        names = names.difference(without)
    for name in expression.undefined(names):
        where = f" (at character {expression.positions[name] + 1})"
        if name in expression.called and name not in scope.model_names:
            flaws.add(f"{unknown_function(name)}{where}", *path)
        elif name in without:
            flaws.add(f"{quoted(name)} comes later; a definition may use earlier ones only{where}", *path)
        elif place == "path" and name in scope.rate_names:
            flaws.add(f"{quoted(name)} is known only where control_rates bounds the rate{where}", *path)
        elif place == "constant" and name in scope.designed:
            what = f"{quoted(name)} is a design parameter or follows from one"
            flaws.add(f"{what}; {_ADVICE[place]}{where}", *path)
        elif name in scope.model_names or name in scope.boundary_names or name in scope.rate_names:
            flaws.add(f"the name {quoted(name)} cannot be used here; {_ADVICE[place]}{where}", *path)
        else:
            known = names | CONSTANTS.keys()
            flaws.add(f"unknown name {quoted(name)}{scope.suggest(name, known)}{where}", *path)


def _check_calls(expression: Expression, scope: Scope, flaws: Flaws, path: Path) -> None:
    """Data tables are called, nothing else is."""
    for name in expression.called & (scope.model_names - scope.table_names):
        flaws.add(f"{quoted(name)} is no data table: it cannot be called; a product needs its '*'", *path)
    plain = {payload for code, payload in expression.program if code == Code.NAME}
    for name in plain & scope.table_names:
        flaws.add(f"{quoted(name)} is a data table: call it with one argument, as in {name}(t)", *path)


_ADVICE = {
    "constant": "a value is a number or an expression in parameters and constants",
    "parameter": "the names here are parameters and constants",
    "model": "the names of a model are its states, controls, parameters, definitions, data tables and t",
    "path": "along the trajectory the names are those of the model, <coordinate>_ddot, <rated control>_dot",
    "boundary": (
        "at the ends the names are <state>_0, <state>_f, likewise of controls, <output>_f, integrals, "
        "parameters, t0 and tf"
    ),
}


def check_constant(value: Any, scope: Scope, flaws: Flaws, *path: str | int) -> float | None:
    """Check a value; return what it is worth, or ``None`` where that cannot be judged."""
    if is_number(value):
        return float(value) if _check_number(value, flaws, path) else None
    before = len(flaws.found)
    check_expression(value, "constant", scope, flaws, *path)
    if len(flaws.found) > before or not parse(value).names <= scope.parameters.keys():
        return None
    try:
        return evaluate_constant(value, scope.parameters)
    except ExpressionError as error:
        flaws.add(error.detail, *path)
        return None


def check_bound(value: Any, scope: Scope, flaws: Flaws, *path: str | int) -> Interval | None:
    """Check a bound; return its interval, or ``None`` where that cannot be judged."""
    if is_number(value) or isinstance(value, str):
        number = check_constant(value, scope, flaws, *path)
        return None if number is None else (number, number)
    if not isinstance(value, list) or len(value) != 2:
        found = f"a list of {len(value)}" if isinstance(value, list) else kind_of(value)
        flaws.add(f"a bound is one value or [lower, upper] (a side may be null), not {found}", *path)
        return None
    sides = [
        free if side is None else check_constant(side, scope, flaws, *path, index)
        for index, (side, free) in enumerate(zip(value, FREE, strict=True))
    ]
    if sides[0] is None or sides[1] is None:
        return None
    if sides[0] > sides[1]:
        flaws.add(f"crossed bounds: the lower side {sides[0]:g} is above the upper side {sides[1]:g}", *path)
        return None
    return sides[0], sides[1]


def interval_of(scope: Scope, bound: Any) -> Interval | None:
    """Return the interval of a bound as submitted, or None where it cannot be judged; no bound is free."""
    return FREE if bound is None else check_bound(bound, scope, Flaws())
