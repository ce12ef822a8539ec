"""End conditions as residuals, and the problems in which they are no conditions any more."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from solvers.expressions import Expression, combined, named, parse, positive_part, product, total
from solvers.formulation.quantities import FREE, Interval
from solvers.problem import OptimalControlProblem


def end_residuals(problem: OptimalControlProblem) -> list[Expression]:
    """What is zero where the ends, the integrals and the boundary constraints are as they shall be.

    Expressions of the ends: x - value for an equation, else how far x is beyond a bound.
    """
    final = [*zip(problem.states, problem.final_state, strict=True)]
    final += [*zip(problem.controls, problem.final_control, strict=True)]
    bounds = [(named(f"{name}_f"), interval) for name, interval in final]
    starts = zip(problem.controls, problem.initial_control, strict=True)
    bounds += [(named(f"{name}_0"), interval) for name, interval in starts]
    bounds += [(named(item.name), item.interval) for item in problem.integrals]
    bounds += [(item.expression, item.interval) for item in problem.boundary]
    return [residual for expression, interval in bounds for residual in excess(expression, interval)]


def excess(expression: Expression, interval: Interval) -> Iterator[Expression]:
    """What is zero where an expression keeps its bounds; nothing where it has none."""
    lower, upper = interval
    if lower == upper:
        yield combined("-", expression, parse(lower))
        return
    if np.isfinite(lower):
        yield positive_part(combined("-", parse(lower), expression))
    if np.isfinite(upper):
        yield positive_part(combined("-", expression, parse(upper)))


def with_free_end(problem: OptimalControlProblem) -> OptimalControlProblem:
    """The problem without conditions on ends and integrals, but for the initial state."""
    free = tuple(FREE for _ in problem.controls)
    return replace(
        problem,
        final_state=tuple(FREE for _ in problem.states),
        initial_control=free,
        final_control=free,
        integrals=tuple(replace(item, interval=FREE) for item in problem.integrals),
        boundary=(),
    )


def with_penalised_end(problem: OptimalControlProblem, penalty: float) -> OptimalControlProblem:
    """The problem with penalty |r|^2 added to its cost in place of the conditions at its end."""
    terms = [product(parse(penalty), residual, residual) for residual in end_residuals(problem)]
    if problem.terminal_cost is not None:
        terms.insert(0, problem.terminal_cost)
    return replace(with_free_end(problem), terminal_cost=total(terms) if terms else None)
