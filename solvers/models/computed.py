"""Quantities of a library model that no expression of the document's language can say."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

Functions = Mapping[str, Callable[..., Any]]


class Formula(Protocol):
    """What can stand for a definition: an expression, or code."""

    @property
    def text(self) -> str:
        """What tells it apart from others."""
        ...

    @property
    def names(self) -> frozenset[str]:
        """The names whose values it needs."""
        ...

    def evaluate(self, values: Mapping[str, Any], functions: Functions) -> Any:
        """Its value."""
        ...


@dataclass(frozen=True)
class Computed:
    """Quantities that one function gives together.

    ``function`` takes values by name and the functions over them; it uses no names but ``inputs``. ``text``
    names the function and every number built into it. Where ``held`` is set it takes plain numbers only, and
    what it gives is held over a step of the integration.
    """

    quantities: tuple[str, ...]
    inputs: frozenset[str]
    function: Callable[[Mapping[str, Any], Functions], tuple[Any, ...]]
    text: str
    held: bool = False

    @property
    def definitions(self) -> dict[str, Formula]:
        """The definitions that stand for it: the whole once, by a name of its own, then its parts."""
        whole = "(" + ", ".join(self.quantities) + ")"  # no name of a document
        parts = {name: _Part(whole, index) for index, name in enumerate(self.quantities)}
        return {whole: Whole(self), **parts}


@dataclass(frozen=True)
class Whole:
    """All that one function gives, as a tuple."""

    computed: Computed

    @property
    def text(self) -> str:
        """See :class:`Formula`."""
        return self.computed.text

    @property
    def names(self) -> frozenset[str]:
        """See :class:`Formula`."""
        return self.computed.inputs

    def evaluate(self, values: Mapping[str, Any], functions: Functions) -> Any:
        """See :class:`Formula`."""
        return self.computed.function(values, functions)


@dataclass(frozen=True)
class _Part:
    whole: str
    index: int

    @property
    def text(self) -> str:
        return f"{self.whole}[{self.index}]"

    @property
    def names(self) -> frozenset[str]:
        return frozenset({self.whole})

    def evaluate(self, values: Mapping[str, Any], functions: Functions) -> Any:
        return values[self.whole][self.index]
