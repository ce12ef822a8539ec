"""How the optimum changes with the numbers of the document: its parameters, bounds and ends.

Where a number y changes a little, the optimum of  min J(w; y), c(w; y) within bounds b(y),  changes as its
Lagrangian does with the unknowns and the multipliers held (the envelope theorem; A. V. Fiacco, Introduction
to Sensitivity and Stability Analysis in Nonlinear Programming, 1983, theorem 3.4.1):

    dJ*/dy = d/dy [J(w; y) + lambda' (c(w; y) - b(y))].

The Lagrangian is evaluated with the number a little larger, and for a parameter of the model a little smaller
too: its bounds as they are then, its functions to first order in the numbers that enter them. Nothing is
solved again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from solvers.errors import pointer
from solvers.expressions import parse
from solvers.formulation.scenarios import cases_of
from solvers.optimizers.outcome import Outcome
from solvers.program import NonlinearProgram
from solvers.solved import Stand
from solvers.spec import BoundValue, PhaseSpec, ProblemSpec, Value, evaluate_constant

Vector = NDArray[np.float64]
Place = tuple[str | int, ...]

# Relative to the number, or by itself where that is 0.
_STEP = 1e-5

_TIMES = ("initial_time", "final_time")
_TABLES = ("initial_state", "final_state", "bounds", "control_rates", "initial_control", "final_control")
_LISTS = ("path_constraints", "boundary_constraints", "integrals")
_OF_CASES = ("initial_state", "final_state", "bounds")


class Varied(NamedTuple):
    """A number of a problem: its place, how it is written, the parameters in which that is an expression."""

    place: Place
    value: Value
    parameters: Mapping[str, float]


class Differentiable(Protocol):
    """A transcription of a problem, with what stands for it where only numbers differ."""

    @property
    def objective_scale(self) -> float:
        """What the objective of the program is multiplied by to give that of the document."""
        ...

    def of(self, problem: Any) -> Self:
        """The same transcription of a problem that differs in numbers only."""
        ...

    def program(self, initial: Vector | None = None) -> NonlinearProgram:
        """The scaled program."""
        ...


def sensitivity(
    spec: ProblemSpec,
    solved: Stand[Any, Any],
    varied: Iterable[Varied],
    problem_of: Callable[[ProblemSpec], Any],
) -> dict[str, float | None]:
    """dJ*/dy by JSON pointer for every number that is ``varied`` of a converged answer.

    A bound is one number or a side of an interval; None where the derivative is no finite number. What is
    optimised itself, and parameters that follow from that, have none. Nor has a parameter that a data table
    names, for the table's numbers are built into the program, or what is written in parameters that differ
    between plants: that is not one number. ``problem_of``: what is solved for a document's problem.
    """
    varied = [*varied]
    built_in = {name for table in spec.tables().values() for name in table.names}
    apart = frozenset[str]().union(*(case.parameters for case in cases_of(spec))) if spec.scenarios else ()
    known = [
        item
        for item in varied
        if not ("parameters" in item.place and item.place[-1] in built_in)
        and not (isinstance(item.value, str) and parse(item.value).names.intersection(apart))
    ]
    found = slopes(spec, solved.transcription, solved.outcome, known, problem_of)
    return {where: found.get(where) for where in (pointer(("problem", *item.place)) for item in varied)}


def slopes(
    spec: ProblemSpec,
    transcription: Differentiable,
    outcome: Outcome,
    varied: Iterable[Varied],
    problem_of: Callable[[ProblemSpec], Any],
) -> dict[str, float | None]:
    """dJ*/dy by JSON pointer for every number that is ``varied``."""
    lagrangian = _Lagrangian(transcription, outcome)
    found: dict[str, float | None] = {}
    for place, value, parameters in varied:
        number = evaluate_constant(value, parameters)
        step = _STEP * abs(number) or _STEP  # of a number that is too small for a part of it, too

        def there(change: float, place: Place = place, number: float = number) -> float:
            return lagrangian(problem_of(_changed(spec, place, number + change)))

        with np.errstate(all="ignore"):
            above = there(step)
            # The Lagrangian is linear in bounds and ends, smooth in parameters.
            below, width = (there(-step), 2.0 * step) if "parameters" in place else (lagrangian.here, step)
        slope = (above - below) / width
        found[pointer(("problem", *place))] = slope if np.isfinite(slope) else None
    return found


class _Lagrangian:
    """The Lagrangian of a neighbouring problem at the answer of this one; ``here``: of this one.

    To first order in the numbers of the program, with the derivatives that the optimizer has left.
    """

    def __init__(self, transcription: Differentiable, outcome: Outcome) -> None:
        self._transcription, self._outcome = transcription, outcome
        own = transcription.program(outcome.unknowns)
        self._numbers = own.numbers
        self._objective, rows = own.values(outcome.unknowns)
        self._held = np.concatenate([outcome.row_multipliers, outcome.bound_multipliers])
        self._values = np.concatenate([rows, outcome.unknowns])
        self.here = self._of(own)

    def __call__(self, problem: Any) -> float:
        return self._of(self._transcription.of(problem).program(self._outcome.unknowns))

    def _of(self, program: NonlinearProgram) -> float:
        change = float(self._outcome.number_slopes @ (program.numbers - self._numbers))
        lower = np.concatenate([program.constraint_lower, program.lower])
        upper = np.concatenate([program.constraint_upper, program.upper])
        active = np.where(self._held > 0.0, upper, lower)
        held = np.isfinite(active)
        resisted = float(self._held[held] @ (self._values - active)[held])
        return (self._objective + change + resisted) * self._transcription.objective_scale


def numbers_of(
    spec: ProblemSpec | PhaseSpec, varied: Mapping[str, Value], parameters: Mapping[str, float]
) -> Iterator[Varied]:
    """Everything in a problem, or in a phase of it, that can be varied, in these ``parameters``.

    ``varied``: the parameters of the model that are, as they are written.
    """
    for place, value in _places(spec, varied):
        yield Varied(place, value, parameters)


def _places(spec: ProblemSpec | PhaseSpec, varied: Mapping[str, Value]) -> Iterator[tuple[Place, Value]]:
    for name, value in varied.items():
        yield ("model", "parameters", name), value
    for key in _TIMES:
        yield from _sides((key,), getattr(spec, key))
    for key in _TABLES:
        for name, bound in getattr(spec, key).items():
            yield from _sides((key, name), bound)
    for key in _LISTS:
        for index, item in enumerate(getattr(spec, key)):
            yield from _sides((key, index, "bounds"), item.bounds)
    if not isinstance(spec, ProblemSpec):
        return
    for name, item in spec.design.items():
        yield from _sides(("design", name, "bounds"), item.bounds)
    for index, case in enumerate(() if spec.scenarios is None else spec.scenarios.cases):
        here = ("scenarios", "cases", index)
        for name, value in case.parameters.items():
            yield (*here, "parameters", name), value
        for key in _OF_CASES:
            for name, bound in getattr(case, key).items():
                yield from _sides((*here, key, name), bound)


def _sides(place: Place, bound: BoundValue) -> Iterator[tuple[Place, Value]]:
    if isinstance(bound, str | int | float):
        yield place, bound
    elif bound is not None:
        for side, value in enumerate(bound):
            if value is not None:
                yield (*place, side), value


def _changed(node: Any, place: Place, number: float) -> Any:
    """A copy of a part of the problem with another number at ``place``."""
    if not place:
        return number
    key, *rest = place
    if isinstance(node, Mapping):
        return {**node, key: _changed(node.get(key), tuple(rest), number)}
    if isinstance(node, list | tuple):
        return [_changed(item, tuple(rest), number) if i == key else item for i, item in enumerate(node)]
    field = "submitted_model" if key == "model" else str(key)
    return node.changed(**{field: _changed(getattr(node, field), tuple(rest), number)})
