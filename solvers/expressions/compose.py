"""Expressions made of expressions, for what the product writes itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce

from solvers.expressions.expression import Code, Expression, Instruction
from solvers.expressions.parser import instruction, parse


def combined(mark: str, left: Expression, right: Expression) -> Expression:
    """Return ``left mark right`` for an operator ``+ - * / ^``; no limit of submitted text applies."""
    return Expression(
        f"({left.text}) {mark} ({right.text})",
        {**right.positions, **left.positions},
        left.operations + right.operations + 1,
        (*left.program, *right.program, instruction(mark)),
        left.called | right.called,
    )


def named(name: str) -> Expression:
    """Return the expression that is this name, even if no document could use it."""
    return Expression(name, {name: 0}, 0, ((Code.NAME, name),))


def total(terms: Sequence[Expression]) -> Expression:
    """Return the sum of the terms, 0 without any."""
    return reduce(lambda left, right: combined("+", left, right), terms) if terms else parse(0)


def product(*factors: Expression) -> Expression:
    """Return the product of the factors, 1 without any."""
    return reduce(lambda left, right: combined("*", left, right), factors) if factors else parse(1)


def applied(function: str, argument: Expression) -> Expression:
    """Return ``function(argument)`` for a function of one argument."""
    return Expression(
        f"{function}({argument.text})",
        argument.positions,
        argument.operations + 1,
        (*argument.program, (Code.CALL, function)),
        argument.called,
    )


def positive_part(expression: Expression) -> Expression:
    """Return max(0, expression)."""
    return Expression(
        f"max(0, {expression.text})",
        expression.positions,
        expression.operations + 1,
        ((Code.NUMBER, 0.0), *expression.program, (Code.PAIR, "max")),
        expression.called,
    )


def renamed(expression: Expression, names: Mapping[str, str]) -> Expression:
    """Return the expression with names replaced; the text names the new ones behind the old text."""
    if not expression.names & names.keys():
        return expression
    program = tuple(
        (code, names.get(payload, payload)) if code in (Code.NAME, Code.LOOKUP) else (code, payload)
        for code, payload in expression.program
    )
    positions = {names.get(name, name): place for name, place in expression.positions.items()}
    changes = ", ".join(f"{name}: {names[name]}" for name in expression.positions if name in names)
    called = frozenset(names.get(name, name) for name in expression.called)
    return Expression(f"{expression.text} {{{changes}}}", positions, expression.operations, program, called)


def operand_of(program: Sequence[Instruction]) -> int:
    """Where the last operand of the last operation of a program begins."""
    start, wanted = len(program) - 1, 1
    while wanted:
        start -= 1
        code = program[start][0]
        wanted += (code in (Code.OPERATOR, Code.PAIR)) - (code in (Code.NAME, Code.NUMBER))
    return start


def part_of(expression: Expression, start: int, stop: int) -> Expression:
    """Return the part of an expression that these instructions make up."""
    if (start, stop) == (0, len(expression.program)):
        return expression
    program = expression.program[start:stop]
    names = {payload: 0 for code, payload in program if code in (Code.NAME, Code.LOOKUP)}
    operations = sum(code not in (Code.NAME, Code.NUMBER) for code, _ in program)
    called = expression.called & names.keys()
    # Structures are told apart by their texts: this one is as long as the part.
    text = " ".join(str(getattr(payload, "__name__", payload)) for _, payload in program)
    return Expression(text, names, operations, program, called)


def operands_of(expression: Expression) -> tuple[Instruction, list[Expression]]:
    """Return the last operation of an expression and its operands."""
    program = expression.program
    last = len(program) - 1
    code = program[last][0]
    if code in (Code.NAME, Code.NUMBER):
        return program[last], []
    if code not in (Code.OPERATOR, Code.PAIR):
        return program[last], [part_of(expression, 0, last)]
    right = operand_of(program)
    return program[last], [part_of(expression, 0, right), part_of(expression, right, last)]


def without(expression: Expression, name: str) -> Expression:
    """Return the expression with a name taken as 0."""
    program = tuple(
        (Code.NUMBER, 0.0) if (code, payload) == (Code.NAME, name) else (code, payload)
        for code, payload in expression.program
    )
    positions = {key: place for key, place in expression.positions.items() if key != name}
    text = f"{expression.text} [{name}: 0]"
    return Expression(text, positions, expression.operations, program, expression.called)
