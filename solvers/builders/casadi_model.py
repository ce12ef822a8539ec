"""A model from a CasADi function: its graph, instruction by instruction, as ``definitions`` and expressions.

CasADi is not imported: whoever has a function of it has done so, and its codes of operations are taken from
the function's own module.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

from solvers.builders.models import Model, first_order
from solvers.errors import ExpressionError

_SAME_NAME = [
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "sinh",
    "cosh",
    "tanh",
    "exp",
    "log",
    "sqrt",
    "sign",
]
# What each operation is in the expression language; operands get parentheses where they need them.
_OPERATIONS = {
    "ADD": "{} + {}",
    "SUB": "{} - {}",
    "MUL": "{}*{}",
    "DIV": "{}/{}",
    "NEG": "-{}",
    "POW": "{}^{}",
    "CONSTPOW": "{}^{}",
    "SQ": "{}^2",
    "TWICE": "2*{}",
    "INV": "1/{}",
    "ASSIGN": "{}",
    "FABS": "abs({})",
    "FMIN": "min({}, {})",
    "FMAX": "max({}, {})",
    "LOG1P": "log(1 + {})",
    "EXPM1": "exp({}) - 1",
    "HYPOT": "sqrt({}^2 + {}^2)",
    **{name.upper(): f"{name}({{}})" for name in _SAME_NAME},
    "ATAN2": "atan2({}, {})",
}
# A longer text gets a name of its own, so that no expression meets the limits of the language.
_LONGEST = 200


@dataclass(frozen=True, slots=True)
class _Text:
    """A written expression; an ``atom`` may stand beside any operator as it is."""

    bare: str
    atom: bool

    @property
    def enclosed(self) -> str:
        """The text as an operand."""
        return self.bare if self.atom else f"({self.bare})"


@dataclass(frozen=True, slots=True)
class _Step:
    """An instruction in single assignment: which earlier steps it takes, and what it is."""

    operation: str
    operands: tuple[int, ...]
    constant: float = 0.0
    place: tuple[int, int] = (0, 0)
    """Argument and element that an input reads, result and element that an output writes."""


def first_order_from_casadi(
    function: Any,
    *,
    states: Sequence[str],
    controls: Sequence[str],
    parameters: Mapping[str, Any] | None = None,
    arguments: Sequence[str] = ("states", "controls", "parameters", "time"),
) -> Model:
    """x' = f(x, u, ...) from a CasADi function, MX or SX, whose first result is x'.

    ``arguments`` says what the function's arguments are, in their order: as many of the four words as it has
    arguments. Elements are named in the order of ``states``, ``controls`` and ``parameters``. Raises
    ValueError where the sizes do not fit, ExpressionError for operations that the language does not have.
    """
    named = {"states": states, "controls": controls, "parameters": list(parameters or {}), "time": ["t"]}
    names = [named[word] for word in arguments[: function.n_in()]]
    sizes = [function.numel_in(index) for index in range(function.n_in())]
    if sizes != [len(group) for group in names]:
        told = ", ".join(f"{len(group)} {word}" for word, group in zip(arguments, names, strict=False))
        raise ValueError(f"the function's arguments have {sizes} elements, and there are {told}")
    if function.numel_out(0) != len(states):
        raise ValueError(
            f"the function's first result has {function.numel_out(0)} elements, not {len(states)}"
        )
    definitions, rates = _written(function if function.is_a("SXFunction") else function.expand(), names)
    return first_order(
        dict(zip(states, rates, strict=True)),
        controls=controls,
        parameters=parameters,
        definitions=definitions,
    )


def _written(function: Any, names: Sequence[Sequence[str]]) -> tuple[dict[str, str], list[str]]:
    """The definitions, and the text of each element of the first result."""
    steps = list(_steps(function))
    uses = Counter(operand for step in steps for operand in step.operands)
    taken = {name for group in names for name in group}
    free = (name for name in map("w{}".format, count(1)) if name not in taken)
    definitions: dict[str, str] = {}
    # What a sparse result leaves out is 0.
    results = ["0"] * function.numel_out(0)
    texts: list[_Text] = []
    for index, step in enumerate(steps):
        operands = [texts[operand] for operand in step.operands]
        if step.operation == "INPUT":
            argument, element = step.place
            text = _Text(names[argument][_element(function.sparsity_in(argument), element)], True)
        elif step.operation == "OUTPUT":
            text = operands[0]
            result, element = step.place
            if result == 0:
                results[_element(function.sparsity_out(0), element)] = text.bare
        elif step.operation == "CONST":
            text = _Text(repr(step.constant), step.constant >= 0)
        else:
            text = _applied(_OPERATIONS[step.operation], operands)
            if uses[index] > 1 or len(text.bare) > _LONGEST:
                name = next(free)
                definitions[name] = text.bare
                text = _Text(name, True)
        texts.append(text)
    return definitions, results


def _applied(template: str, operands: Sequence[_Text]) -> _Text:
    """The text of an operation; the arguments of a function have its parentheses around them already."""
    if template.endswith(("({})", "({}, {})")):
        return _Text(template.format(*(operand.bare for operand in operands)), True)
    return _Text(template.format(*(operand.enclosed for operand in operands)), False)


def _steps(function: Any) -> Iterator[_Step]:
    """The instructions of an SX function: registers that are used again become steps of their own."""
    codes = sys.modules[type(function).__module__]
    names = {value: name.removeprefix("OP_") for name, value in vars(codes).items() if name.startswith("OP_")}
    registers: dict[int, int] = {}
    for index in range(function.n_instructions()):
        operation = names[function.instruction_id(index)]
        read, written = function.instruction_input(index), function.instruction_output(index)
        if operation == "INPUT":
            yield _Step(operation, (), place=(read[0], read[1]))
        elif operation == "OUTPUT":
            yield _Step(operation, (registers[read[0]],), place=(written[0], written[1]))
            continue
        elif operation == "CONST":
            yield _Step(operation, (), constant=function.instruction_constant(index))
        elif operation in _OPERATIONS:
            yield _Step(operation, tuple(registers[register] for register in read))
        else:
            raise ExpressionError(f"the expression language has no word for CasADi's {operation.lower()}", 0)
        registers[written[0]] = index


def _element(sparsity: Any, nonzero: int) -> int:
    """Which element, column after column, a nonzero is."""
    return int(sparsity.row()[nonzero] + sparsity.size1() * sparsity.get_col()[nonzero])
