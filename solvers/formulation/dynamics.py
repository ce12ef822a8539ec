"""The equations of motion of a problem: bodies of second order, then states of first order.

Every callable takes a scope (name -> value: floats, NumPy arrays of one shape, CasADi symbols) and the
backend to which the values belong.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.backends import Backend
from solvers.expressions import Expression, parse
from solvers.models import Formula
from solvers.spec import FirstOrderModel, MechanicalModel

Matrix = tuple[tuple[Expression, ...], ...]
Scope = Mapping[str, Any]
Values = Sequence[Any] | NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """M(q) q'' + C(q, q') q' + K q = G u + f(q, q', t) with n coordinates and m controls.

    ``mass``, ``damping``, ``stiffness`` n x n, ``input`` n x m, ``force`` n expressions; C, K, f may be None.
    """

    coordinates: tuple[str, ...]
    velocities: tuple[str, ...]
    accelerations: tuple[str, ...]
    controls: tuple[str, ...]
    mass: Matrix
    input: Matrix
    damping: Matrix | None = None
    stiffness: Matrix | None = None
    force: tuple[Expression, ...] | None = None

    @classmethod
    def from_model(cls, model: MechanicalModel) -> Body:
        """The body of a mechanical model."""

        def matrix(key: str) -> Matrix | None:
            rows = model.rows(key)
            return None if rows is None else tuple(tuple(map(parse, row)) for row in rows)

        return cls(
            coordinates=model.coordinates,
            velocities=model.states[len(model.coordinates) :],
            accelerations=tuple(f"{name}_ddot" for name in model.coordinates),
            controls=model.controls,
            mass=matrix("mass") or (),
            input=matrix("input") or (),
            damping=matrix("damping"),
            stiffness=matrix("stiffness"),
            force=None if model.force is None else tuple(map(parse, model.force)),
        )

    @property
    def expressions(self) -> Iterator[Expression]:
        """Every expression of the body."""
        for matrix in (self.mass, self.damping or (), self.stiffness or (), self.input, (self.force or (),)):
            for row in matrix:
                yield from row

    @property
    def layout(self) -> Hashable:
        """The number of coordinates, and which of the optional matrices there are."""
        parts = self.damping, self.stiffness, self.force
        return len(self.coordinates), tuple(part is None for part in parts)

    def residual(self, acceleration: Values, scope: Scope, backend: Backend) -> list[Any]:
        """Evaluate M q'' + C q' + K q - G u - f, one value a coordinate."""
        loads = self._loads(scope, backend)
        mass = _values(self.mass, scope, backend)
        return [_dot(row, acceleration) - load for row, load in zip(mass, loads, strict=True)]

    def equations(self, scope: Scope, backend: Backend) -> tuple[list[list[Any]], list[Any]]:
        """Evaluate M, (n, n) as rows, and G u + f - C q' - K q, one value a coordinate."""
        return _values(self.mass, scope, backend), self._loads(scope, backend)

    def acceleration(self, scope: Scope, backend: Backend) -> list[Any]:
        """Evaluate M^-1 (G u + f - C q' - K q), one value a coordinate."""
        return backend.solve(*self.equations(scope, backend))

    def _loads(self, scope: Scope, backend: Backend) -> list[Any]:
        """G u + f - C q' - K q."""
        terms = [_products(self.input, self.controls, scope, backend)]
        for matrix, names in ((self.damping, self.velocities), (self.stiffness, self.coordinates)):
            if matrix is not None:
                terms.append([-value for value in _products(matrix, names, scope, backend)])
        if self.force is not None:
            terms.append([entry.evaluate(scope, backend.functions) for entry in self.force])
        return [sum(parts) for parts in zip(*terms, strict=True)]


@dataclass(frozen=True)
class Dynamics:
    """Bodies of second order and ``first_order`` states with the expression of their rate.

    The states are the coordinates of all bodies, their velocities in the same order, the first-order states.
    """

    bodies: tuple[Body, ...] = ()
    first_order: Mapping[str, Expression] = field(default_factory=dict)

    @classmethod
    def from_model(cls, model: MechanicalModel | FirstOrderModel) -> Dynamics:
        """The dynamics of a model of a document."""
        if isinstance(model, MechanicalModel):
            return cls((Body.from_model(model),))
        return cls((), {name: parse(rate) for name, rate in model.dynamics.items()})

    @property
    def states(self) -> tuple[str, ...]:
        """The names of the states in order."""
        coordinates = [name for body in self.bodies for name in body.coordinates]
        velocities = [name for body in self.bodies for name in body.velocities]
        return (*coordinates, *velocities, *self.first_order)

    @property
    def coordinates(self) -> int:
        """The number n of coordinates: the first n states, whose velocities are the next n."""
        return sum(len(body.coordinates) for body in self.bodies)

    @property
    def expressions(self) -> list[Expression]:
        """Every expression of the equations."""
        return [*(item for body in self.bodies for item in body.expressions), *self.first_order.values()]

    @property
    def layout(self) -> Hashable:
        """What tells apart dynamics with the same list of expressions."""
        return tuple(body.layout for body in self.bodies), tuple(self.first_order)

    def residual(self, acceleration: Values, scope: Scope, backend: Backend) -> list[Any]:
        """Evaluate M q'' + C q' + K q - G u - f, one value a coordinate."""
        values, start = [], 0
        for body in self.bodies:
            stop = start + len(body.coordinates)
            values += body.residual(acceleration[start:stop], scope, backend)
            start = stop
        return values

    def mass(self, scope: Scope, backend: Backend) -> list[list[Any]]:
        """Evaluate M, (n, n), as rows."""
        rows: list[list[Any]] = []
        for body in self.bodies:
            before, after = len(rows), self.coordinates - len(rows) - len(body.coordinates)
            block = _values(body.mass, scope, backend)
            rows += [[*[0.0] * before, *row, *[0.0] * after] for row in block]
        return rows

    def rate(self, scope: Scope, backend: Backend) -> list[Any]:
        """Evaluate (q', q'', f), one value a state."""
        velocities = [scope[name] for body in self.bodies for name in body.velocities]
        accelerations = [value for body in self.bodies for value in body.acceleration(scope, backend)]
        rates = [rate.evaluate(scope, backend.functions) for rate in self.first_order.values()]
        return [*velocities, *accelerations, *rates]


class NodeScope(dict[str, Any]):
    """Name -> value at one instant, or at many side by side.

    Definitions and accelerations are evaluated once, where somebody asks for them.
    """

    def __init__(
        self,
        given: Mapping[str, Any],
        dynamics: Dynamics,
        definitions: Mapping[str, Formula],
        backend: Backend,
    ) -> None:
        super().__init__(given)
        self._dynamics, self._definitions, self._backend = dynamics, definitions, backend

    def __missing__(self, name: str) -> Any:
        if name in self._definitions:
            # In order, so that a definition finds those that it uses: no recursion however long the chain.
            for known, expression in self._definitions.items():
                if known not in self:
                    self[known] = expression.evaluate(self, self._backend.functions)
                if known == name:
                    return self[name]
        for body in self._dynamics.bodies:
            if name in body.accelerations:
                self.update(zip(body.accelerations, body.acceleration(self, self._backend), strict=True))
                return self[name]
        raise KeyError(name)


def _values(matrix: Matrix, scope: Scope, backend: Backend) -> list[list[Any]]:
    return [[entry.evaluate(scope, backend.functions) for entry in row] for row in matrix]


def _products(matrix: Matrix, names: Sequence[str], scope: Scope, backend: Backend) -> list[Any]:
    vector = [scope[name] for name in names]
    return [_dot(row, vector) for row in _values(matrix, scope, backend)]


def _dot(row: Values, vector: Values) -> Any:
    return sum(
        (entry * value for entry, value in zip(row, vector, strict=True) if not _is_zero(entry)), start=0.0
    )


def _is_zero(entry: Any) -> bool:
    return isinstance(entry, float) and entry == 0.0
