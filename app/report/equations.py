"""A problem as an engineer writes it: equations of motion, objective, constraints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import add

from markupsafe import Markup

from app.report.mathml import Formula, column, equation, formula, inline, integral, matrix, name
from solvers.models import LIBRARY
from solvers.spec import (
    BoundValue,
    FirstOrderModel,
    LibraryReference,
    MechanicalModel,
    ProblemSpec,
    SubmittedModel,
    Value,
    written_out,
)
from solvers.spec.modal import ModalEquations

# Wider rows of a matrix are told entry by entry, in characters.
_WIDEST_ROW = 110
_MATRICES = {"mass": "M", "damping": "C", "stiffness": "K", "input": "G"}
_D = Formula("<mi>d</mi>")
_INFINITY = Formula("<mi>∞</mi>")


@dataclass
class Block:
    """A few formulas under a heading; ``note`` is plain text."""

    title: str
    note: str = ""
    lines: list[Markup] = field(default_factory=list)


def model_blocks(model: SubmittedModel) -> list[Block]:
    """The equations of motion, with what they are made of."""
    note = ""
    if isinstance(model, LibraryReference):
        known = LIBRARY[model.name]
        note = f"{known.title}. Source: {known.source}."
    equations = written_out(model)
    blocks = [Block("Equations of motion", note)]
    if isinstance(model, ModalEquations):
        blocks[0].note = (
            f"Rigid axes with {len(model.modes)} {model.mode_basis} modes of unit modal mass, written out in "
            "the axes and the modal coordinates."
        )
    if isinstance(equations, MechanicalModel):
        blocks[0].lines = list(_mechanical(equations))
    else:
        blocks[0].lines = list(_first_order(equations))
    if equations.definitions:
        lines = [equation(name(key), formula(value)) for key, value in equations.definitions.items()]
        blocks.append(Block("Definitions", lines=lines))
    return blocks


def problem_blocks(problem: ProblemSpec) -> Iterator[Block]:
    """Objective, constraints, integrals and outputs."""
    terms = list(_objective_terms(problem))
    if terms:
        least = Formula('<mi>min</mi><mspace width="0.3em"/><mi>J</mi>')
        yield Block("Objective", lines=[equation(least, reduce(add, terms))])
    ends = [
        equation(*_between(formula(item.expression), item.bounds)) for item in problem.boundary_constraints
    ]
    if ends:
        yield Block("Boundary constraints", lines=ends)
    path = [equation(*_between(formula(item.expression), item.bounds)) for item in problem.path_constraints]
    if path:
        yield Block("Path constraints", lines=path)
    integrals = [equation(name(item.name), integral(formula(item.expression))) for item in problem.integrals]
    if integrals:
        yield Block("Integrals", lines=integrals)
    outputs = [equation(name(item.name), formula(item.expression)) for item in problem.outputs]
    if outputs:
        yield Block("Outputs", lines=outputs)


def bound_text(bound: BoundValue) -> str | Markup:
    """A bound as a cell of a table, in MathML: a value, an interval, or free."""
    if bound is None:
        return "free"
    if isinstance(bound, str | int | float):
        return inline(formula(bound))
    lower, upper = bound
    if lower is None and upper is None:
        return "free"
    low, high = _limit(lower, -_INFINITY), _limit(upper, _INFINITY)
    return inline(Formula(f"<mo>[</mo>{low.xml}<mo>,</mo>{high.xml}<mo>]</mo>"))


def _mechanical(model: MechanicalModel) -> Iterator[Markup]:
    def term(letter: str, vector: str, dots: str = "") -> Formula:
        return name(letter) * name(vector + dots)

    left, right = term("M", "q", "_ddot"), term("G", "u")
    if model.damping is not None:
        left += term("C", "q", "_dot")
    if model.stiffness is not None:
        left += term("K", "q")
    if model.force is not None:
        right += name("f")
    yield equation(left, right)
    yield equation(name("q"), column(map(name, model.coordinates)))
    if model.controls:
        yield equation(name("u"), column(map(name, model.controls)))
    for key, letter in _MATRICES.items():
        rows = model.rows(key)
        if rows and rows[0]:
            yield from _matrix(letter, rows)
    if model.force is not None:
        yield from _matrix("f", [[entry] for entry in model.force])


def _matrix(letter: str, rows: Sequence[Sequence[Value]]) -> Iterator[Markup]:
    """The matrix as a whole, or its entries that are not 0 where its rows are too wide."""
    if max(sum(len(str(entry)) + 2 for entry in row) for row in rows) <= _WIDEST_ROW:
        yield equation(name(letter), matrix(rows))
        return
    for i, row in enumerate(rows, 1):
        for j, entry in enumerate(row, 1):
            if entry not in (0, "0"):
                place = f"{i}" if len(row) == 1 else f"{i},{j}"
                yield equation(
                    Formula(f"<msub><mi>{letter}</mi><mtext>{place}</mtext></msub>"), formula(entry)
                )


def _first_order(model: FirstOrderModel) -> Iterator[Markup]:
    for state, rate in model.dynamics.items():
        yield equation(_D * name(state) / (_D * name("t")), formula(rate))


def _objective_terms(problem: ProblemSpec) -> Iterator[Formula]:
    given = problem.objective
    if given.terminal is not None:
        yield formula(given.terminal)
    if given.running is not None:
        yield integral(formula(given.running))
    if given.maximum is not None:
        yield Formula("<munder><mi>max</mi><mi>t</mi></munder>") * formula(given.maximum)


def _between(middle: Formula, bound: BoundValue) -> tuple[Formula, Formula, str]:
    """Left side, right side and relation of a constraint."""
    if bound is None or isinstance(bound, str | int | float):
        return middle, formula(bound if bound is not None else 0), "="
    lower, upper = bound
    if lower is None:
        return middle, _limit(upper, _INFINITY), "≤"
    if upper is None:
        return middle, formula(lower), "≥"
    return formula(lower), Formula(f"{middle.xml}<mo>≤</mo>{formula(upper).xml}"), "≤"


def _limit(value: Value | None, otherwise: Formula) -> Formula:
    return otherwise if value is None else formula(value)
