"""The output that a flexible model brings by itself: the energy in its elastic coordinates.

E = 1/2 v' M_ee v + 1/2 q' K_ee q over the elastic coordinates q, with their velocities v: what swings on
after a manoeuvre, while the rigid motion is at rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from solvers.expressions import Expression, parse, product, total
from solvers.spec import FirstOrderModel, MechanicalModel, Value


def vibration_energy(model: MechanicalModel | FirstOrderModel) -> Expression | None:
    """The energy of a model's elastic coordinates; None for a model that names none."""
    if not isinstance(model, MechanicalModel) or not model.flexible:
        return None
    index = [model.coordinates.index(name) for name in model.flexible]
    velocities = [f"{name}_dot" for name in model.flexible]
    terms = [*_quadratic(model.rows("mass") or (), index, velocities)]
    terms += _quadratic(model.rows("stiffness") or (), index, model.flexible)
    return product(parse(0.5), total(terms))


def _quadratic(
    matrix: Sequence[Sequence[Value]], index: Sequence[int], names: Sequence[str]
) -> Iterator[Expression]:
    """The terms of x' A x without those of zeros."""
    for i, left in zip(index, names, strict=True) if matrix else ():
        for j, right in zip(index, names, strict=True):
            entry = parse(matrix[i][j])
            if entry.text != "0.0":
                yield product(entry, parse(left), parse(right))
