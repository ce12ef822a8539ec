"""The equations of a model apart from any problem: what a plant consists of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from solvers.backends import Backend
from solvers.formulation.dynamics import Dynamics, NodeScope
from solvers.models import LIBRARY, Computed, Formula
from solvers.spec import LibraryReference, SubmittedModel, definitions_of, written_out


@dataclass(frozen=True)
class Equations:
    """x' = f(x, u, t) with the names of a document; ``held``: what is held over a step of the integration."""

    states: tuple[str, ...]
    controls: tuple[str, ...]
    parameters: Mapping[str, float]
    dynamics: Dynamics
    definitions: Mapping[str, Formula]
    held: tuple[Computed, ...] = ()

    @classmethod
    def of(cls, submitted: SubmittedModel) -> Equations:
        """The equations of the ``model`` object of a checked document."""
        model = written_out(submitted)
        parameters = model.parameter_values()
        held: tuple[Computed, ...] = ()
        if isinstance(submitted, LibraryReference):
            held = tuple(item for item in LIBRARY[submitted.name].formulas(parameters) if item.held)
        return cls(
            model.states,
            model.controls,
            parameters,
            Dynamics.from_model(model),
            definitions_of(submitted, model),
            held,
        )

    @property
    def held_names(self) -> tuple[str, ...]:
        """Names of all quantities that are held."""
        return tuple(name for item in self.held for name in item.quantities)

    def scope(
        self,
        x: Sequence[Any],
        u: Sequence[Any],
        t: Any,
        backend: Backend,
        held: Mapping[str, Any] | None = None,
    ) -> NodeScope:
        """Name the values of one instant; quantities that are held are computed where they are not given."""
        given = {
            **self.parameters,
            **dict(zip(self.states, x, strict=True)),
            **dict(zip(self.controls, u, strict=True)),
            "t": t,
        }
        definitions = self.definitions
        if held is not None:
            given |= held
            inside = {name for item in self.held for name in item.definitions}
            definitions = {name: formula for name, formula in definitions.items() if name not in inside}
        return NodeScope(given, self.dynamics, definitions, backend)

    def rate(
        self,
        x: Sequence[Any],
        u: Sequence[Any],
        t: Any,
        backend: Backend,
        held: Mapping[str, Any] | None = None,
    ) -> list[Any]:
        """Evaluate f, one value a state."""
        return self.dynamics.rate(self.scope(x, u, t, backend, held), backend)
