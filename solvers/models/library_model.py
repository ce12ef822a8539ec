"""What a model that comes with the product consists of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Quantity:
    """A state or a control: its unit and its meaning."""

    unit: str
    description: str


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter: its value unless a document overrides it, its unit and its meaning.

    A value may be an expression in the parameters before it.
    """

    value: float | str
    unit: str
    description: str


@dataclass(frozen=True, slots=True)
class LibraryModel:
    """A named model: its equations as the ``model`` object of a document, and what its names mean.

    ``equations`` holds every key of the model object except ``parameters``.
    """

    name: str
    title: str
    source: str
    states: Mapping[str, Quantity]
    controls: Mapping[str, Quantity]
    parameters: Mapping[str, Parameter]
    equations: Mapping[str, Any]

    def document(self, overrides: Mapping[str, Any]) -> dict[str, Any]:
        """Return the model object with parameters; overrides of parameters it does not have are left out."""
        values = {name: overrides.get(name, parameter.value) for name, parameter in self.parameters.items()}
        return {**self.equations, "parameters": values}
