"""What a model that comes with the product consists of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from solvers.models.computed import Computed

Functions = Mapping[str, Callable[..., Any]]
Map = Callable[[Mapping[str, Any], Functions], dict[str, Any]]
"""From values by name, and the functions over them, to other values by name."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A state, a control or a computed quantity: its unit and its meaning."""

    unit: str
    description: str


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter: its value unless a document overrides it, its unit and its meaning.

    A value may be an expression in the parameters before it. ``interval``: where the model makes sense.
    """

    value: float | str
    unit: str
    description: str
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class View:
    """How a plant is seen as a simpler model and started from it.

    ``observe`` gives that model's states from the plant's states and parameters, ``start`` the reverse;
    ``periods``: what is added to an observed state when it comes round once.
    """

    observe: Map
    start: Map
    periods: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Option:
    """A choice of structure: its value unless a document says otherwise, what may be chosen, its meaning."""

    value: int | str
    choices: tuple[int | str, ...]
    description: str

    def allows(self, value: object) -> bool:
        """Whether a value is one of the choices; true and 1.0 are not 1."""
        return any(type(value) is type(choice) and value == choice for choice in self.choices)


@dataclass(frozen=True, slots=True)
class LibraryModel:
    """A named model: its equations as the ``model`` object of a document, and what its names mean.

    ``equations`` holds every key of the model object except ``parameters``. What no expression can say is
    ``computed``: names that the equations and a document's expressions may use, given by the ``formulas`` for
    the numbers of the parameters. ``views``: simpler model -> how this one is seen as it. ``options`` change
    the structure: ``variant`` is the model for values of all of them. ``positive``: parameters that must be.
    """

    name: str
    title: str
    source: str
    states: Mapping[str, Quantity]
    controls: Mapping[str, Quantity]
    parameters: Mapping[str, Parameter]
    equations: Mapping[str, Any]
    computed: Mapping[str, Quantity] = field(default_factory=dict)
    formulas: Callable[[Mapping[str, float]], Sequence[Computed]] = lambda _: ()
    views: Mapping[str, View] = field(default_factory=dict)
    plant_only: bool = False
    """Whether it can be flown, but not be optimised: some of its formulas take numbers only."""

    options: Mapping[str, Option] = field(default_factory=dict)
    variant: Callable[[Mapping[str, Any]], LibraryModel] | None = None
    positive: tuple[str, ...] = ()

    def with_options(self, chosen: Mapping[str, Any]) -> LibraryModel:
        """Return the model with these options; what is no choice of an option leaves it as it is."""
        if self.variant is None:
            return self
        values = {
            name: chosen[name] if name in chosen and option.allows(chosen[name]) else option.value
            for name, option in self.options.items()
        }
        return self.variant(values)

    def document(self, overrides: Mapping[str, Any]) -> dict[str, Any]:
        """Return the model object with parameters; overrides of parameters it does not have are left out."""
        values = {name: overrides.get(name, parameter.value) for name, parameter in self.parameters.items()}
        return {**self.equations, "parameters": values}
