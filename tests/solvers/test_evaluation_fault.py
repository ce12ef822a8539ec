"""What is said of expressions that have no value, no slope or no curvature where they are needed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solvers.solve import solve
from solvers.spec import check_document


def problem(rate: str = "u", **changes: Any) -> dict[str, Any]:
    """x' = rate from 0 to 1 in a second, with |u| of at most 4."""
    model = {"kind": "first_order", "states": ["x"], "controls": ["u"], "dynamics": {"x": rate}}
    return {
        "model": model,
        "final_time": 1,
        "initial_state": {"x": 0},
        "final_state": {"x": 1},
        "bounds": {"u": [-4, 4]},
        "objective": {"running": "u^2"},
        **changes,
    }


FAULTS = {
    # d sqrt(x) / dx = 1 / (2 sqrt(x))
    "slope": (
        problem("u - sqrt(x)"),
        "/problem/model/dynamics/x: 'u - sqrt(x)' has a value, but no finite slope over x at t = 0 (",
    ),
    # d2 x^1.5 / dx2 = 3 / (4 sqrt(x))
    "curvature": (
        problem(objective={"running": "u^2 + x^1.5"}),
        "/problem/objective/running: 'u^2 + x^1.5' has a value, but no finite curvature over x at t = 0 (",
    ),
    "end": (
        problem(final_state={"x": 0}, objective={"running": "u^2", "terminal": "sqrt(x_f)"}),
        "/problem/objective/terminal: 'sqrt(x_f)' has a value, but no finite slope over x_f at t = 1 (",
    ),
    "value": (
        problem("u + log(x - 2)", bounds={"u": [-4, 4], "x": [0, 1]}),
        "/problem/model/dynamics/x: 'u + log(x - 2)' has no finite value at t = 0 (",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_message_names_the_expression_and_what_it_has_not(fault: str) -> None:
    document, message = FAULTS[fault]
    method = {"name": "hermite_simpson", "intervals": 6}
    solution = solve(check_document({"problem": document, "method": method}))
    assert solution.status.value == "evaluation_error"
    assert message in solution.message
    assert "x = 0" in solution.message or "x_f = 0" in solution.message
    assert "; what helps is" in solution.message
    assert ("gpm" in solution.message) == (fault in ("slope", "curvature"))


@pytest.mark.parametrize("method", ["swcm", "gpm"])
def test_a_mechanical_model_without_a_value_is_named(
    flexible_spacecraft: dict[str, Any], method: str
) -> None:
    flexible_spacecraft["problem"]["model"]["force"] = [0, "sqrt(-1 - theta^2)"]
    solution = solve(check_document({**flexible_spacecraft, "method": {"name": method}}))
    assert solution.status.value == "evaluation_error"
    assert "/problem/model/force/1: 'sqrt(-1 - theta^2)' has no finite value at t = 0 (" in solution.message
    assert np.isnan(solution.costates).all()


@pytest.mark.parametrize(
    ("method", "start"),
    [({"name": "gpm", "nodes": 12}, 0), ({"name": "hermite_simpson", "intervals": 12}, 1e-6)],
    ids=lambda value: str(value),
)
def test_what_the_message_advises_helps(method: dict[str, Any], start: float) -> None:
    """A method without a node at the ends, or a start that keeps off the corner."""
    document = problem("u - sqrt(x)", initial_state={"x": start}, bounds={"x": [start, None]})
    solution = solve(check_document({"problem": document, "method": method}))
    assert solution.status.value in ("converged", "unverified")
