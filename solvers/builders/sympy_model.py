"""Models from SymPy expressions: what they have in common is written once, as ``definitions``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from solvers.builders.models import Model, first_order, mechanical
from solvers.builders.sympy_text import sympy_text
from solvers.errors import ExpressionError


def first_order_from_sympy(
    dynamics: Mapping[Any, Any], *, controls: Sequence[Any], parameters: Mapping[Any, Any] | None = None
) -> Model:
    """x' = f(x, u, t): state -> SymPy expression of its rate, states as symbols or names.

    Dynamic symbols ``x(t)`` are written by their names. Raises ExpressionError for what the expression
    language has no word for.
    """
    states = list(map(_name, dynamics))
    definitions, rates = _shared(list(dynamics.values()))
    return first_order(
        dict(zip(states, rates, strict=True)),
        controls=list(map(_name, controls)),
        parameters=parameters,
        definitions=definitions,
    )


def mechanical_from_sympy(
    mass: Any,
    forcing: Any,
    *,
    coordinates: Sequence[Any],
    controls: Sequence[Any],
    parameters: Mapping[Any, Any] | None = None,
    flexible: Sequence[Any] = (),
) -> Model:
    """M(q) q'' = h(q, q', u, t), as ``sympy.physics.mechanics`` gives them.

    ``mass`` (n x n) and ``forcing`` (n x 1) are `LagrangesMethod.mass_matrix` and ``.forcing``; coordinates
    and controls are dynamic symbols or symbols. The forcing must be affine in the controls: h = G u + f, with
    G free of the controls. Raises ExpressionError where it is not.
    """
    import sympy

    inputs = sympy.Matrix(forcing)
    # Symbols of their own: a control u(t) cannot be differentiated by.
    stand_ins = {control: sympy.Dummy(_name(control)) for control in controls}
    moved = inputs.subs(stand_ins)
    effect = moved.jacobian(list(stand_ins.values())) if controls else sympy.zeros(inputs.rows, 0)
    rest = moved.subs(dict.fromkeys(stand_ins.values(), 0))
    if set(stand_ins.values()) & effect.free_symbols:
        raise ExpressionError("the forcing is not affine in the controls", 0)
    size = inputs.rows
    entries = [*sympy.Matrix(mass), *effect, *rest]
    definitions, texts = _shared(entries)
    rows = [texts[start : start + size] for start in range(0, size * size, size)]
    width = len(controls)
    behind = texts[size * size :]
    return mechanical(
        mass=rows,
        input=[behind[row * width : (row + 1) * width] for row in range(size)],
        force=behind[size * width :],
        coordinates=list(map(_name, coordinates)),
        controls=list(map(_name, controls)),
        parameters=parameters,
        definitions=definitions,
        flexible=list(map(_name, flexible)),
    )


def _name(symbol: Any) -> str:
    return symbol if isinstance(symbol, str) else sympy_text(symbol)


def _shared(expressions: Sequence[Any]) -> tuple[dict[str, str], list[str]]:
    """What the expressions have in common, by name and in order, and the texts that use it."""
    import sympy

    read = [_plainly(sympy.sympify(expression)) for expression in expressions]
    taken = {str(symbol) for expression in read for symbol in expression.atoms(sympy.Symbol)}
    common, written = sympy.cse(read, symbols=_free_names(taken))
    definitions = {str(symbol): sympy_text(expression) for symbol, expression in common}
    return definitions, list(map(sympy_text, written))


def _plainly(expression: Any) -> Any:
    """Dynamic symbols and their derivatives as symbols, so that nothing is looked for inside them."""
    import sympy
    from sympy.core.function import AppliedUndef

    inner = expression.atoms(sympy.Derivative, AppliedUndef)
    return expression.xreplace({node: sympy.Symbol(sympy_text(node)) for node in inner})


def _free_names(taken: set[str]) -> Iterator[Any]:
    import sympy

    return (symbol for symbol in sympy.numbered_symbols("common") if str(symbol) not in taken)
