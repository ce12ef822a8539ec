"""Two controls that count by the length of their vector, by that length and an angle instead.

A thrust that costs sqrt(Tx^2 + Ty^2) has a kink where it is off, which is where an optimum coasts: there is
no gradient, and no bound that a control could rest on. As T (cos a, sin a) it is smooth, its limit a bound,
and arcs of full thrust and of none are bang arcs with exact instants. The optimum is the same.

The length and the angle are controls of names that no document can use; the components are definitions. The
verification flies the components, as the document says it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.curves import Curve, at_the_same_nodes, through, values_of
from solvers.expressions import Code, Expression, applied, named, operand_of, part_of, product
from solvers.formulation.other_controls import NewControl, Piece, may_be_replaced, with_other_controls
from solvers.formulation.quantities import FREE, WHOLE_SPAN, Constraint, Interval
from solvers.problem import OptimalControlProblem

# What stands beside the squares under the root is a rounding where its root is this part of the length.
_NEGLIGIBLE = 1e-8
# A vector of this part of the longest has no direction but that of its roundings.
_DIRECTED = 1e-4
# Where expressions are told apart: any points.
_POINTS = np.array([[0.3, -1.7, 2.9], [-1.1, 0.6, 2.3]])

Vector = NDArray[np.float64]
Names = tuple[str, str]


@dataclass(frozen=True)
class Pair:
    """Two controls as ``size`` times the cosine and the sine of ``angle``."""

    controls: Names
    size: str
    angle: str

    def components(self, controls: Mapping[str, Curve]) -> dict[str, Curve]:
        """The curves of the two controls from those of the size and the angle, at the same nodes."""
        size, angle = controls[self.size], controls[self.angle]
        return {
            name: at_the_same_nodes(size, angle, partial(_component, function))
            for name, function in zip(self.controls, (np.cos, np.sin), strict=True)
        }

    def replaced(self, controls: Mapping[str, Curve]) -> dict[str, Curve]:
        """The curves of the size and the angle from those of the two controls."""
        x, y = (controls[name] for name in self.controls)
        size = at_the_same_nodes(x, y, np.hypot)
        shortest = _DIRECTED * float(values_of(size).max(initial=0.0))
        angle = at_the_same_nodes(x, y, partial(_angle, shortest))
        return {self.size: size, self.angle: through(angle, _continued)}


def in_polar(problem: OptimalControlProblem) -> tuple[OptimalControlProblem, tuple[Pair, ...]]:
    """The problem with every such pair replaced, and the pairs."""
    pairs = []
    for names in combinations(problem.controls, 2):
        if all(name in problem.controls for name in names) and _counts_by_length(problem, names):
            pair = Pair(names, f"size@{names[0]}", f"angle@{names[0]}")
            problem = _replaced(problem, pair)
            pairs.append(pair)
    return problem, tuple(pairs)


def _counts_by_length(problem: OptimalControlProblem, names: Names) -> bool:
    """Whether the length of two controls stands under a root, and nothing is said of their ends."""
    if not all(may_be_replaced(problem, name) for name in names):
        return False
    work = _Lengths(names, problem.parameters, _limits(problem, names)[1])
    if any(work.roots(item) for body in problem.dynamics.bodies for item in body.expressions):
        return False
    costs = [] if problem.running_cost is None else [problem.running_cost]
    formulas = [item for item in problem.definitions.values() if isinstance(item, Expression)]
    along = [item.expression for item in problem.integrals]
    return any(
        work.roots(item) for item in (*problem.dynamics.first_order.values(), *formulas, *along, *costs)
    )


def _replaced(problem: OptimalControlProblem, pair: Pair) -> OptimalControlProblem:
    names, limits = pair.controls, _limits(problem, pair.controls)
    work = _Lengths(names, problem.parameters, limits[1], pair.size)
    components = {
        name: product(named(pair.size), applied(function, named(pair.angle)))
        for name, function in zip(names, ("cos", "sin"), strict=True)
    }
    definitions = {
        name: work.rewritten(item) if isinstance(item, Expression) else item
        for name, item in problem.definitions.items()
    }
    rates = {name: work.rewritten(rate) for name, rate in problem.dynamics.first_order.items()}
    rewritten = replace(
        problem,
        definitions=definitions,
        dynamics=replace(problem.dynamics, first_order=rates),
        running_cost=problem.running_cost and work.rewritten(problem.running_cost),
        integrals=tuple(replace(it, expression=work.rewritten(it.expression)) for it in problem.integrals),
        path=(*_path(problem, work), *_own_bounds(problem, names, limits[1])),
    )
    length, angle = _guessed(problem, names, limits)
    new = [NewControl(pair.size, limits, length), NewControl(pair.angle, FREE, angle)]
    return with_other_controls(rewritten, components, new)


def _guessed(problem: OptimalControlProblem, names: Names, bounds: Interval) -> tuple[Piece, Piece]:
    """Length and angle of the vector that is guessed; where that is nothing, a length within its bounds."""
    pieces = [problem.guess.controls[problem.controls.index(name)] for name in names]
    tau = np.unique(np.concatenate([points for points, _ in pieces]))
    x, y = (np.interp(tau, *piece) for piece in pieces)
    if not (x.any() or y.any()):
        middle = 0.5 * sum(bounds) if np.isfinite(bounds[1]) else max(bounds[0], 1.0)
        return (tau, np.full(tau.size, middle)), (tau, np.zeros(tau.size))
    return (tau, np.clip(np.hypot(x, y), *bounds)), (tau, np.unwrap(np.arctan2(y, x)))


def _limits(problem: OptimalControlProblem, names: Names) -> Interval:
    """What path constraints on the length, or on its square, say of it."""
    lower, upper = 0.0, np.inf
    work = _Lengths(names, problem.parameters)
    for item in problem.path:
        sides = work.length_bounds(item)
        if sides is not None:
            lower, upper = max(lower, sides[0]), min(upper, sides[1])
    return lower, upper


def _path(problem: OptimalControlProblem, work: _Lengths) -> Iterator[Constraint]:
    for item in problem.path:
        if work.length_bounds(item) is None:
            yield replace(item, expression=work.rewritten(item.expression))


def _own_bounds(problem: OptimalControlProblem, names: Names, longest: float) -> Iterator[Constraint]:
    """The bounds of the two controls themselves, where the longest vector does not keep them anyway."""
    for name in names:
        bounds = problem.control_bounds[problem.controls.index(name)]
        if any(np.isfinite(side) and abs(side) < longest for side in bounds):
            yield Constraint(name, problem.bound_pointer(name), named(name), bounds)


@dataclass(frozen=True)
class _Lengths:
    """Finds the length of a vector in expressions, and writes its name there."""

    names: Names
    parameters: Mapping[str, float]
    longest: float = np.inf
    size: str = ""

    def roots(self, expression: Expression) -> list[tuple[int, int]]:
        """Where the root of the sum of both squares stands in the program: start and stop."""
        found, program = [], expression.program
        for index, (code, payload) in enumerate(program):
            if code == Code.CALL and payload == "sqrt":
                start = operand_of(program[: index + 1])
                beside = self._beside_squares(part_of(expression, start, index))
                if beside is not None and np.sqrt(beside) <= min(_NEGLIGIBLE * self.longest, 1.0):
                    found.append((start, index + 1))
        return found

    def rewritten(self, expression: Expression) -> Expression:
        """The expression with the name of the length in the place of every such root."""
        found = self.roots(expression)
        if not found:
            return expression
        program = list(expression.program)
        for start, stop in reversed(found):
            program[start:stop] = [(Code.NAME, self.size)]
        used = {payload for code, payload in program if code in (Code.NAME, Code.LOOKUP)}
        positions = {name: place for name, place in expression.positions.items() if name in used}
        text = f"{expression.text} {{{self.size}}}"
        return Expression(
            text, {**positions, self.size: 0}, len(program), tuple(program), expression.called & used
        )

    def length_bounds(self, constraint: Constraint) -> Interval | None:
        """What a path constraint says of the length, if that is all it speaks of."""
        expression, (lower, upper) = constraint.expression, constraint.interval
        if constraint.during != WHOLE_SPAN:
            return None
        if self._beside_squares(expression) == 0.0:
            return float(np.sqrt(max(lower, 0.0))), float(np.sqrt(upper)) if upper >= 0.0 else -1.0
        code, payload = expression.program[-1]
        if code == Code.CALL and payload == "sqrt":
            inner = part_of(expression, 0, len(expression.program) - 1)
            return (max(lower, 0.0), upper) if self._beside_squares(inner) == 0.0 else None
        return None

    def _beside_squares(self, expression: Expression) -> float | None:
        """What is added to the sum of both squares; None where an expression is something else."""
        if not set(self.names) <= expression.names <= {*self.names, *self.parameters}:
            return None
        values = {**self.parameters, **dict(zip(self.names, _POINTS, strict=True))}
        with np.errstate(all="ignore"):
            beside = expression.evaluate(values, NUMPY.functions) - (_POINTS**2).sum(axis=0)
            zero = expression.evaluate({**values, **dict.fromkeys(self.names, 0.0)}, NUMPY.functions)
        return float(zero) if zero >= 0.0 and np.allclose(beside, zero, rtol=0.0, atol=1e-12) else None


def _component(function: Callable[[Any], Any], size: Any, angle: Any) -> Any:
    return size * function(angle)


def _angle(shortest: float, x: Vector, y: Vector) -> Vector:
    """The direction of vectors, NaN where they are no longer than the ``shortest``."""
    return np.where(np.hypot(x, y) > shortest, np.arctan2(y, x), np.nan)


def _continued(angles: Vector) -> Vector:
    """The angles without jumps by whole turns, and between their neighbours where there are none."""
    known = np.flatnonzero(np.isfinite(angles))
    if not known.size:
        return np.zeros_like(angles)
    return np.interp(np.arange(angles.size), known, np.unwrap(angles[known]))
