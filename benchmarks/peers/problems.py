"""The catalogue's cases for libraries that know nothing of ondelette; needs NumPy, which all of them have.

Reads the same JSON document that ondelette solves, so that bounds, ends, guess and model are the same by
construction. Expressions are evaluated over whatever a library computes with (its ``functions``: an object
with sin, cos, exp, ...). Only what the benchmark's cases use is understood; anything else raises ValueError.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT))  # a peer's environment has no ondelette: only its parser is wanted
from solvers.expressions import parse  # noqa: E402

CASES = ROOT / "solvers" / "cases"
TOLERANCE = 1e-8
MAX_ITERATIONS = 3000
FUNCTIONS = ("sin", "cos", "tan", "exp", "log", "sqrt")
CONSTANTS = {"pi": math.pi, "deg": math.pi / 180}
Interval = tuple[float, float]


@dataclass(frozen=True)
class Case:
    """One case as numbers; intervals hold -inf and inf where there is no bound.

    Guesses hold values at equally spaced fractions of the time span.
    """

    name: str
    states: tuple[str, ...]
    controls: tuple[str, ...]
    model: dict[str, Any]
    parameters: dict[str, float]
    objective: dict[str, str]
    initial: dict[str, float]
    final: dict[str, float]
    bounds: dict[str, Interval]
    final_time: Interval
    guess_time: float
    guesses: dict[str, list[float]]

    @property
    def free_time(self) -> bool:
        """Whether the final time is an unknown."""
        return self.final_time[0] < self.final_time[1]

    def rates(self, x: Sequence[Any], u: Sequence[Any], functions: Any) -> list[Any]:
        """State derivatives, one value a state."""
        scope = self._scope(x, u, functions)
        if self.model["kind"] == "first_order":
            return [evaluate(self.model["dynamics"][name], scope) for name in self.states]
        n = len(self.model["coordinates"])
        matrices = {
            key: [[evaluate(entry, scope) for entry in row] for row in self.model[key]]
            for key in ("mass", "damping", "stiffness", "input")
            if key in self.model
        }
        loads = [sum(a * b for a, b in zip(row, u, strict=True)) for row in matrices["input"]]
        for key, values in (("damping", x[n:]), ("stiffness", x[:n])):
            for i, row in enumerate(matrices.get(key, [])):
                loads[i] = loads[i] - sum(a * b for a, b in zip(row, values, strict=True))
        return [*x[n:], *solve(matrices["mass"], loads)]

    def running(self, x: Sequence[Any], u: Sequence[Any], functions: Any) -> Any:
        """The integrand of the objective; None without one."""
        text = self.objective.get("running")
        return None if text is None else evaluate(text, self._scope(x, u, functions))

    def terminal(self, final: Sequence[Any], final_time: Any, functions: Any) -> Any:
        """The objective's part at the end; None without one."""
        text = self.objective.get("terminal")
        if text is None:
            return None
        scope = {f"{name}_f": value for name, value in zip(self.states, final, strict=True)}
        return evaluate(text, {**self._scope((), (), functions), **scope, "tf": final_time})

    def guess(self, name: str, fraction: float) -> float:
        """The guess of a state or control at this fraction of the time span."""
        values = self.guesses[name]
        place = min(max(fraction, 0.0), 1.0) * (len(values) - 1)
        left = min(int(place), len(values) - 2)
        return values[left] + (place - left) * (values[left + 1] - values[left])

    def _scope(self, x: Sequence[Any], u: Sequence[Any], functions: Any) -> dict[str, Any]:
        known = {name: getattr(functions, name) for name in FUNCTIONS if hasattr(functions, name)}
        values = {**dict(zip(self.states, x, strict=False)), **dict(zip(self.controls, u, strict=False))}
        return {**CONSTANTS, **known, **self.parameters, **values}


def evaluate(text: str | float, scope: dict[str, Any]) -> Any:
    """The value of an expression of a document of the catalogue."""
    if not isinstance(text, str):
        return text
    return parse(text).evaluate(scope, scope)


def solve(matrix: list[list[Any]], right: list[Any]) -> list[Any]:
    """Cramer's rule for one or two unknowns, over any numbers."""
    if len(right) == 1:
        return [right[0] / matrix[0][0]]
    if len(right) != 2:
        raise ValueError("models of more than two coordinates are not among the benchmark's cases")
    (a, b), (c, d) = matrix
    determinant = a * d - b * c
    return [(d * right[0] - b * right[1]) / determinant, (a * right[1] - c * right[0]) / determinant]


def load(name: str) -> Case:
    """Read a case. Raises ValueError where it uses what is not understood here."""
    problem = json.loads((CASES / f"{name}.json").read_text())["problem"]
    if problem.get("path_constraints") or problem.get("boundary_constraints"):
        raise ValueError(f"{name} has constraints that the peers' scripts do not pass on")
    model = problem["model"]
    parameters: dict[str, float] = {}
    for key, value in model.get("parameters", {}).items():
        parameters[key] = float(evaluate(value, {**CONSTANTS, **parameters}))
    states = model.get("states") or [
        *model["coordinates"],
        *(f"{coordinate}_dot" for coordinate in model["coordinates"]),
    ]
    controls = model["controls"]

    def number(value: str | float) -> float:
        return float(evaluate(value, {**CONSTANTS, **parameters}))

    def interval(value: Any) -> Interval:
        if not isinstance(value, list):
            return (number(value), number(value))
        lower, upper = value
        return (-math.inf if lower is None else number(lower), math.inf if upper is None else number(upper))

    ends = [
        {key: number(value) for key, value in problem.get(which, {}).items()}
        for which in ("initial_state", "final_state")
    ]
    bounds = {key: interval(problem.get("bounds", {}).get(key, [None, None])) for key in (*states, *controls)}
    given = problem.get("guess", {})
    final_time = interval(problem["final_time"])
    guesses = {}
    for key in (*states, *controls):
        values = {**given.get("states", {}), **given.get("controls", {})}.get(key)
        if values is not None:
            guesses[key] = [number(value) for value in values]
        elif key in controls:
            lower, upper = bounds[key]
            guesses[key] = [(lower + upper) / 2 if math.isfinite(upper - lower) else 0.0] * 2
        else:
            guesses[key] = [end.get(key, other.get(key, 0.0)) for end, other in (ends, ends[::-1])]
    return Case(
        name=name,
        states=tuple(states),
        controls=tuple(controls),
        model=model,
        parameters=parameters,
        objective=problem["objective"],
        initial=ends[0],
        final=ends[1],
        bounds=bounds,
        final_time=final_time,
        guess_time=number(given["final_time"]) if "final_time" in given else sum(final_time) / 2,
        guesses=guesses,
    )
