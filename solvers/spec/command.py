"""The ``command`` of the output: how a control is put into a table."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from solvers.expressions import quoted
from solvers.spec.base import SpecModel
from solvers.spec.checks import check_constant
from solvers.spec.faults import Flaws, kind_of, refuse
from solvers.spec.fields import VALUE_SCHEMA, Check, Real
from solvers.spec.phases import flown_names, flown_scopes
from solvers.spec.scope import Scope
from solvers.spec.tables import object_of, unknown_key


class Rule(Check):
    """How a row follows from the control."""

    def check(self, value: Any, scope: Scope) -> str:
        """Return the word."""
        if value in ("average", "sample"):
            return str(value)
        found = quoted(value) if isinstance(value, str) else kind_of(value)
        raise refuse(f"must be 'average' or 'sample', not {found}")

    def schema(self) -> dict[str, Any]:
        """One of two words."""
        return {"enum": ["average", "sample"]}


class QuantumTable(Check):
    """Control -> smallest step of its values."""

    def check(self, value: Any, scope: Scope) -> dict[str, float]:
        """Return the steps as numbers."""
        table, flaws, found = object_of(value), Flaws(), dict[str, float]()
        scopes = flown_scopes(scope) if table else []
        controls, known = flown_names(scopes, "controls"), all(own.known for own in scopes)
        for name, entry in table.items():
            if known and name not in controls:
                flaws.add(unknown_key(name, "control", controls, scope), name)
                continue
            number = check_constant(entry, scope, flaws, name)
            if number is not None and number <= 0.0:
                flaws.add(f"must be greater than 0, not {number:g}", name)
            elif number is not None:
                found[name] = number
        flaws.raise_any()
        return found

    def schema(self) -> dict[str, Any]:
        """An object of values."""
        return {"type": "object", "additionalProperties": VALUE_SCHEMA}


class CommandSpec(SpecModel):
    """A table of values, each held for one period."""

    period: Annotated[float, Real(above=0)]
    """For how long a row holds."""
    rule: Annotated[Literal["average", "sample"], Rule()] = "average"
    """``average``: the exact mean over the period; ``sample``: the value at its start."""
    quantum: Annotated[dict[str, float], QuantumTable()] = Field(default_factory=dict)
    """Control -> step to whose multiples its values are rounded, within its bounds."""
    delay: Annotated[float, Real(least=0)] = 0.0
    """How much later than its time a row takes effect."""
