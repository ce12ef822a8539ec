"""Costs with corners, made smooth without changing the optimum: peaks, and abs, min, max where they only add.

``maximum``: an unknown that the expression must not exceed anywhere is minimised instead of the peak.

In a running cost (or an integral of which more is nowhere asked for: it is bounded above only, and a sum of
costs or of what is bounded above), a term c abs(e) with c > 0 becomes c s with a
slack s >= e, s >= -e at every node; c max(a, b) becomes c s with s >= a, s >= b; and -c min(a, b) likewise.
The slack costs, so that it comes down to the larger of the two. Slacks are controls of a name that no
document can use; the verification flies the document's own expressions.
"""

from __future__ import annotations

import operator
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.expressions import (
    Code,
    Expression,
    combined,
    named,
    operand_of,
    operands_of,
    parse,
    part_of,
    product,
    total,
    without,
)
from solvers.expressions.expression import Instruction, divide
from solvers.formulation.integral_costs import (
    constant,
    exact_integrals,
    held_integral,
    multiple_of,
    said_at_the_ends,
)
from solvers.formulation.quantities import FREE, Constraint, DesignParameter, Interval
from solvers.formulation.two_sided import TwoSides, may_be_split, with_sides
from solvers.problem import OptimalControlProblem

Vector = NDArray[np.float64]

PEAK = "peak@"
FLIGHT_PEAK = "peak@@"
"""How the unknowns of peaks over several phases begin; no plant is called @."""
_MAXIMUM = "/problem/objective/maximum"
_SLACK = "slack@"
_SAMPLES = 129
_ABOVE: Interval = (0.0, np.inf)
_MARKS = {operator.add: "+", operator.sub: "-", operator.mul: "*", divide: "/"}


def with_peak(problem: OptimalControlProblem, suffix: str = "") -> OptimalControlProblem:
    """The problem whose peak cost is an unknown in the terminal cost."""
    peak = problem.peak_cost
    if peak is None:
        return problem
    name = PEAK + suffix
    terminal = (
        named(name) if problem.terminal_cost is None else combined("+", problem.terminal_cost, named(name))
    )
    below = below_peak(problem, peak, name, peak_of_guess(problem, peak))
    return replace(below, peak_cost=None, terminal_cost=terminal)


def below_peak(
    problem: OptimalControlProblem, peak: Expression, name: str, guess: float
) -> OptimalControlProblem:
    """The problem with an unknown of this name, from ``guess`` on, that ``peak`` does not exceed anywhere."""
    limit = Constraint(name, _MAXIMUM + name, combined("-", peak, named(name)), (-np.inf, 0.0))
    return replace(
        problem,
        path=(*problem.path, limit),
        design=(*problem.design, DesignParameter(name, FREE, guess)),
    )


def peak_of_guess(problem: OptimalControlProblem, peak: Expression) -> float:
    """The largest value of an expression along the guess."""
    return float(_along_the_guess(problem, peak).max())


def lifted(
    problem: OptimalControlProblem, *, split: bool = False, exact: Collection[str] = ()
) -> OptimalControlProblem:
    """The problem with slacks for abs, min and max in its running cost and its integrals.

    ``split``: bounded controls whose magnitude is a running cost become two
    (:mod:`solvers.formulation.two_sided`). ``exact``: integrals that count elsewhere, and may not be more
    than they are.
    """
    if split:
        problem = _counted_along(problem)
    work = _Lifting(problem, {side.control: side for side in may_be_split(problem)} if split else {})
    running = problem.running_cost
    if running is not None:
        running = work.lift(running)
    work.sides = {name: side for name, side in work.sides.items() if name in work.used}
    held = [
        *said_at_the_ends(problem.boundary, problem.terminal_cost),
        *map(held_integral, problem.integrals),
    ]
    exact = exact_integrals(problem.integrals, held, problem.parameters).union(exact)
    integrals = tuple(
        item if item.name in exact else replace(item, expression=work.lift(item.expression))
        for item in problem.integrals
    )
    path = tuple(
        replace(item, expression=work.lift(item.expression)) if item.name.startswith(PEAK) else item
        for item in problem.path
    )
    if not work.slacks and not work.sides:
        return problem
    start = problem
    problem = with_sides(problem, [*work.sides.values()]) if work.sides else problem
    tau = np.linspace(0.0, 1.0, _SAMPLES)
    pieces = tuple((tau, _along_the_guess(start, slack)) for slack in work.slacks.values())
    free = (FREE,) * len(work.slacks)
    return replace(
        problem,
        controls=(*problem.controls, *work.slacks),
        control_bounds=(*problem.control_bounds, *free),
        initial_control=(*problem.initial_control, *free),
        final_control=(*problem.final_control, *free),
        path=(*path, *work.limits),
        running_cost=running,
        integrals=integrals,
        guess=replace(problem.guess, controls=(*problem.guess.controls, *pieces)),
    )


def _counted_along(problem: OptimalControlProblem) -> OptimalControlProblem:
    """The problem in which integrals of corners that the terminal cost adds are a running cost instead.

    As such they may be split.
    """
    terminal, parameters = problem.terminal_cost, problem.parameters
    if terminal is None:
        return problem
    running = [] if problem.running_cost is None else [problem.running_cost]
    for item in problem.integrals:
        factor = multiple_of(terminal, item.name, parameters)
        weight = None if factor is None else constant(factor, parameters)
        if factor is None or weight is None or not has_corners(item.expression):
            continue
        if not has_corners(_Lifting(problem).lift(item.expression, weight)):
            running.append(product(factor, item.expression))
            terminal = without(terminal, item.name)
    return replace(problem, running_cost=total(running) if running else None, terminal_cost=terminal)


def is_slack(name: str) -> bool:
    """Whether a control is a slack."""
    return name.startswith(_SLACK)


def bounded_only(problem: OptimalControlProblem) -> frozenset[str]:
    """The integrals with slacks, which may be as large as their bounds: their sums are not the integrals."""
    slacks = list(filter(is_slack, problem.controls))
    return frozenset(item.name for item in problem.integrals if not item.expression.names.isdisjoint(slacks))


def corners(problem: OptimalControlProblem) -> Iterator[tuple[str, str]]:
    """Yield where abs, sign, min or max is left: the pointer, and the text of the expression."""
    places: list[tuple[str, Expression | None]] = [
        ("/problem/objective/terminal", problem.terminal_cost),
        ("/problem/objective/running", problem.running_cost),
    ]
    places += [
        (_MAXIMUM, item.expression)
        for item in problem.path
        if item.name.startswith(PEAK) and not item.name.startswith(FLIGHT_PEAK)
    ]
    places += [(f"{item.pointer}/expression", item.expression) for item in problem.integrals]
    for pointer, expression in places:
        if expression is not None and has_corners(expression):
            yield pointer, expression.text


def nonsmooth(pointer: str, text: str) -> dict[str, str]:
    """The warning that corners stay."""
    detail = f"'{text}' keeps its corners; the optimizer expects smooth functions."
    return {"code": "nonsmooth", "pointer": pointer, "detail": detail}


def has_corners(expression: Expression) -> bool:
    """Whether abs, sign, min or max is left in an expression."""
    return any(map(_has_corner, expression.program))


def _has_corner(step: Instruction) -> bool:
    code, payload = step
    return (code == Code.CALL and payload in ("abs", "sign")) or (
        code == Code.PAIR and payload in ("min", "max")
    )


@dataclass
class _Lifting:
    """Slacks by name with what they start from, and what holds them up."""

    problem: OptimalControlProblem
    sides: dict[str, TwoSides] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    slacks: dict[str, Expression] = field(default_factory=dict)
    limits: list[Constraint] = field(default_factory=list)

    def lift(self, expression: Expression, sign: float = 1.0) -> Expression:
        """The expression, which counts with ``sign``, with slacks where these are equivalent."""
        program, stop = expression.program, len(expression.program)
        corner = next((index for index, step in enumerate(program) if _has_corner(step)), stop)
        # A long sum is a deep tree on its left: it is walked down, not called down.
        behind: list[tuple[str, Expression, float | None]] = []
        while corner < stop:
            code, payload = program[stop - 1]
            mark = _MARKS.get(payload, "") if code == Code.OPERATOR else ""
            right = part_of(expression, operand_of(program[:stop]), stop - 1) if mark else None
            if right is not None and mark in "+-":
                behind.append((mark, right, sign if mark == "+" else -sign))
            elif right is not None and (factor := constant(right, self.problem.parameters)) is not None:
                behind.append((mark, right, None))
                sign *= float(np.sign(factor))
            else:
                break
            stop -= len(right.program) + 1
        result = part_of(expression, 0, stop)
        if corner < stop:
            result = self._lift_last(result, sign)
        for mark, right, its_sign in reversed(behind):
            result = combined(mark, result, right if its_sign is None else self.lift(right, its_sign))
        return result

    def _lift_last(self, expression: Expression, sign: float) -> Expression:
        """The same where the last operation has nothing to its left that could be lifted by itself."""
        (code, payload), operands = operands_of(expression)
        if code == Code.NEGATE:
            return product(parse(-1.0), self.lift(operands[0], -sign))
        if code == Code.OPERATOR and payload is operator.mul:
            left, right = operands
            factor = constant(left, self.problem.parameters)
            if factor is not None:
                return combined("*", left, self.lift(right, sign * np.sign(factor)))
        if code == Code.CALL and payload == "abs" and sign > 0.0 and operands[0].text in self.sides:
            self.used.add(operands[0].text)
            return self.sides[operands[0].text].magnitude
        if code == Code.CALL and payload == "abs" and sign > 0.0:
            return self._slack(expression, operands[0], product(parse(-1.0), operands[0]))
        if code == Code.PAIR and payload == "max" and sign > 0.0:
            return self._slack(expression, *operands)
        if code == Code.PAIR and payload == "min" and sign < 0.0:
            below = [product(parse(-1.0), item) for item in operands]
            return product(parse(-1.0), self._slack(product(parse(-1.0), expression), *below))
        return expression

    def _slack(self, start: Expression, *below: Expression) -> Expression:
        """A slack that is at least as large as each of ``below``, which together make ``start``."""
        name = f"{_SLACK}{len(self.slacks)}"
        self.slacks[name] = start
        for number, item in enumerate(below):
            expression = combined("-", named(name), item)
            self.limits.append(Constraint(f"{name}/{number}", f"/{name}/{number}", expression, _ABOVE))
        return named(name)


def _along_the_guess(problem: OptimalControlProblem, expression: Expression) -> Vector:
    guess, tau = problem.guess, np.linspace(0.0, 1.0, _SAMPLES)
    times = guess.t0 + (guess.tf - guess.t0) * tau
    parameters = {**problem.parameters, **guess.design}
    scope = problem.scope(guess.states_at(tau), guess.controls_at(tau), times, parameters, NUMPY)
    with np.errstate(all="ignore"):
        values = expression.evaluate(scope, NUMPY.functions)
    return np.nan_to_num(np.array(np.broadcast_to(values, tau.shape), np.float64))
