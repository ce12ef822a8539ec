"""A problem in which other controls stand in the place of some, which become definitions in terms of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.formulation.quantities import FREE, Interval
from solvers.models import Formula
from solvers.problem import OptimalControlProblem

Piece = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Values at points of normalised time."""


@dataclass(frozen=True)
class NewControl:
    """A control that no document names, within ``bounds``, guessed as ``piece``."""

    name: str
    bounds: Interval
    piece: Piece


def with_other_controls(
    problem: OptimalControlProblem, definitions: Mapping[str, Formula], new: list[NewControl]
) -> OptimalControlProblem:
    """The problem with ``new`` controls behind its own, without those that ``definitions`` define."""
    kept = [index for index, name in enumerate(problem.controls) if name not in definitions]

    def others(items: tuple[Any, ...], added: list[Any]) -> tuple[Any, ...]:
        return (*(items[j] for j in kept), *added)

    free = [FREE] * len(new)
    guessed = others(problem.guess.controls, [item.piece for item in new])
    return replace(
        problem,
        controls=others(problem.controls, [item.name for item in new]),
        control_bounds=others(problem.control_bounds, [item.bounds for item in new]),
        initial_control=others(problem.initial_control, free),
        final_control=others(problem.final_control, free),
        definitions={**definitions, **problem.definitions},
        guess=replace(problem.guess, controls=guessed),
    )


def may_be_replaced(problem: OptimalControlProblem, name: str) -> bool:
    """Whether nothing is said of the values of a control at the ends.

    And whether it is no rate of a control: these are slopes of states for every method.
    """
    index = problem.controls.index(name)
    bounded = np.isfinite([problem.initial_control[index], problem.final_control[index]]).any()
    is_rate = name in {f"{control}_dot" for control in problem.rated}
    return not bounded and not is_rate and not is_named_at_the_ends(problem, name)


def is_named_at_the_ends(problem: OptimalControlProblem, name: str) -> bool:
    """Whether a boundary constraint or the terminal cost names a control."""
    return not problem.named_at_the_ends.isdisjoint((f"{name}_0", f"{name}_f"))
