"""Whether the numbers of a modal model can be those of a body: inertia, frequencies, damping, couplings."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic_core import PydanticCustomError

from solvers.errors import ExpressionError
from solvers.spec.faults import Flaws, Path
from solvers.spec.matrices import MatrixOf, matrix_rows
from solvers.spec.scope import Scope, mapping
from solvers.spec.values import Value, evaluate_constant

_PLACE: Path = ("problem", "model")


def check_modal(scope: Scope, flaws: Flaws) -> None:
    """Note what no body has; what cannot be evaluated is reported where it stands."""
    model = scope.model
    modes = [mapping(mode) for mode in model.get("modes", ())]
    for index, mode in enumerate(modes):
        frequency = _number(mode.get("frequency_hz"), scope)
        if frequency is not None and frequency <= 0.0:
            detail = f"must be greater than 0, not {frequency:g}"
            flaws.add(detail, *_PLACE, "modes", index, "frequency_hz")
        damping = _number(mode.get("damping", 0), scope)
        if damping is not None and damping < 0.0:
            flaws.add(f"must be at least 0, not {damping:g}", *_PLACE, "modes", index, "damping")
    inertia = _inertia(scope)
    if inertia is None:
        return
    if np.max(np.abs(inertia - inertia.T)) > 1e-9 * np.max(np.abs(inertia)):
        flaws.add("an inertia matrix is symmetric", *_PLACE, "inertia")
    elif _smallest(inertia) <= 0.0:
        flaws.add("an inertia matrix is positive definite", *_PLACE, "inertia")
    elif model.get("mode_basis") == "constrained":
        _check_couplings(inertia, modes, scope, flaws)


def _check_couplings(inertia: np.ndarray, modes: list[dict[str, Any]], scope: Scope, flaws: Flaws) -> None:
    """What the modes move at rest cannot have more inertia than the whole."""
    left = inertia.copy()
    for index, mode in enumerate(modes):
        values = mode.get("coupling")
        numbers = [_number(value, scope) for value in values] if isinstance(values, list) else []
        if len(numbers) != len(inertia) or None in numbers:
            return
        coupling = np.array(numbers, np.float64)
        left = left - np.outer(coupling, coupling)
        smallest = _smallest(left)
        if smallest <= 1e-12 * np.max(np.abs(inertia)):
            detail = (
                "the couplings are not physical: the inertia minus the sum of delta delta' up to this mode"
                f" must be positive definite, but has the eigenvalue {smallest:.6g}"
            )
            flaws.add(detail, *_PLACE, "modes", index, "coupling")
            return


def _inertia(scope: Scope) -> np.ndarray | None:
    n = len(scope.axes)
    try:
        check = MatrixOf("axes", rows="axes", place="parameter")
        rows = matrix_rows(check.check(scope.model.get("inertia"), scope), n, n)
    except PydanticCustomError:
        return None
    numbers = [[_number(entry, scope) for entry in row] for row in rows]
    return None if any(None in row for row in numbers) else np.array(numbers, np.float64)


def _number(value: Value | None, scope: Scope) -> float | None:
    if value is None or isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return evaluate_constant(value, scope.parameters)
    except ExpressionError:
        return None


def _smallest(matrix: np.ndarray) -> float:
    return float(np.linalg.eigvalsh(matrix)[0])
