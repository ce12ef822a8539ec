"""Whether the mass matrix can be inverted where a flight begins."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic_core import PydanticCustomError

from solvers.errors import ExpressionError
from solvers.expressions import parse
from solvers.spec.checks import check_constant, interval_of
from solvers.spec.faults import Flaws, Path
from solvers.spec.matrices import MatrixOf, matrix_rows
from solvers.spec.scope import Scope, mapping
from solvers.spec.values import FREE, Interval, inside

# A matrix with rows and columns scaled to 1 is taken as singular below this reciprocal condition number.
_SINGULAR = 1e-13


def check_mass(scope: Scope, flaws: Flaws) -> None:
    """The mass matrix must be finite and regular at the start, or at the guess where the start is free."""
    n = len(scope.coordinates)
    mass = scope.model.get("mass")
    if isinstance(mass, list):
        if len(mass) != n or any(not isinstance(row, list) or len(row) != n for row in mass):
            return  # reported where it stands, as everything else that is passed over here
    else:
        try:
            mass = MatrixOf("coordinates").check(mass, scope)
        except PydanticCustomError:
            return
    point = _start(scope)
    matrix = np.empty((n, n))
    try:
        with np.errstate(all="ignore"):
            for name, definition in mapping(scope.model.get("definitions")).items():
                point[name] = parse(definition).evaluate(point)
            for i, row in enumerate(mass if isinstance(mass, list) else matrix_rows(mass, n, n)):
                for j, entry in enumerate(row):
                    matrix[i, j] = parse(entry).evaluate(point)
    except (ExpressionError, KeyError, TypeError):
        return
    given = scope.problem["model"].get("mass")  # the rows of the library are nobody's fault
    place: Path = ("problem", "model") if given is None else ("problem", "model", "mass")
    if not np.isfinite(matrix).all():
        i, j = (int(index) for index in np.argwhere(~np.isfinite(matrix))[0])
        detail = f"the mass matrix is not finite at the start: entry {i}, {j} is {matrix[i, j]}"
        flaws.add(detail, *place, *_place_of_entry(given, i, j))
    elif _is_singular(matrix):
        flaws.add("the mass matrix is singular at the start", *place)


def _place_of_entry(given: Any, row: int, column: int) -> Path:
    """Where an entry stands in a matrix that is given as rows, as a diagonal or by entries."""
    if isinstance(given, list):
        return row, column
    if "diag" in mapping(given):
        return "diag", row
    for index, (i, j, _) in enumerate(mapping(given).get("entries", ())):
        if (i, j) == (row, column) or (given.get("symmetric") and (j, i) == (row, column)):
            return "entries", index, 2
    return ()


def _is_singular(matrix: np.ndarray) -> bool:
    size = np.abs(matrix)
    if not (size.max(axis=0) > 0).all() or not (size.max(axis=1) > 0).all():
        return True
    scaled = matrix / size.max(axis=1, keepdims=True)
    scaled = scaled / np.abs(scaled).max(axis=0)
    values = np.linalg.svd(scaled, compute_uv=False)
    return bool(values[-1] <= _SINGULAR * values[0])


def _start(scope: Scope) -> dict[str, float]:
    """Return a value for every name of the model at the start, as the default guess would choose it."""
    bounds, guess = mapping(scope.problem.get("bounds")), mapping(scope.problem.get("guess"))
    point = dict(scope.parameters)
    point["t"] = inside(interval_of(scope, scope.problem.get("initial_time", 0)) or FREE)
    for key, names in (("states", scope.states), ("controls", scope.controls)):
        for name in names:
            given = _first_value(mapping(guess.get(key)).get(name), scope)
            candidates = [_end(scope, "initial_state", name)]
            if candidates[0][0] < candidates[0][1] and given is not None:
                point[name] = given
                continue
            candidates += [_end(scope, "final_state", name), interval_of(scope, bounds.get(name)) or FREE]
            point[name] = inside(next((c for c in candidates if c != FREE), FREE))
    return point


def _end(scope: Scope, key: str, name: str) -> Interval:
    ends = mapping(scope.problem.get(key))
    return interval_of(scope, ends.get(name, ends.get("*"))) or FREE


def _first_value(history: Any, scope: Scope) -> float | None:
    values = history.get("values") if isinstance(history, dict) else history
    return check_constant(values[0], scope, Flaws()) if isinstance(values, list) and values else None
