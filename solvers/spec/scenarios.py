"""The ``scenarios`` of a problem: one command for several plants."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import Field

from solvers.errors import ExpressionError
from solvers.expressions import parse, quoted
from solvers.spec.base import SpecModel
from solvers.spec.checks import check_expression
from solvers.spec.faults import Flaws, refuse
from solvers.spec.fields import VALUE_SCHEMA, Check, Text, at_most
from solvers.spec.scope import Scope, mapping
from solvers.spec.tables import BoundTable, object_of, unknown_key
from solvers.spec.values import BoundValue, Value, evaluate_constant

MAX_CASES = 16
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*", re.ASCII)
_LONGEST = 64


class CaseName(Text):
    """The name of a case: letters, digits, and ``_ . + -``."""

    def check(self, value: Any, scope: Scope) -> str:
        """Return the name."""
        name = super().check(value, scope)
        if not _NAME.fullmatch(name):
            raise refuse("a case is named by letters, digits, and _ . + - behind the first")
        if name == "nominal":
            raise refuse("'nominal' is the document without a case; 'nominal': true adds it")
        return name

    def schema(self) -> dict[str, Any]:
        """A short text."""
        return {**super().schema(), "pattern": f"^{_NAME.pattern}$"}


class CaseParameters(Check):
    """Values for some parameters of the model, which may use those that stand before them in the model."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        table, flaws = object_of(value), Flaws()
        for name, entry in table.items():
            if scope.known and name not in scope.parameter_names:
                flaws.add(unknown_key(name, "parameter", scope.parameter_names, scope), name)
            elif name in scope.designed:
                flaws.add(f"{quoted(name)} is a design parameter or follows from one: it is common", name)
            else:
                check_expression(entry, "constant", scope, flaws, name)
        flaws.raise_any()
        if scope.known:
            _check_values(table, scope, flaws)
            flaws.raise_any()
        return table

    def schema(self) -> dict[str, Any]:
        """An object of values."""
        return {"type": "object", "additionalProperties": VALUE_SCHEMA}


def _check_values(table: dict[str, Any], scope: Scope, flaws: Flaws) -> None:
    """Every parameter must have a value in this case too, in the order of the model."""
    values: dict[str, float] = {}
    for name, own in mapping(scope.model.get("parameters")).items():
        value = table.get(name, own)
        try:
            later = parse(value).undefined(values)
            if later and name in table:
                flaws.add(f"{quoted(later[0])} comes later; a parameter may use earlier ones only", name)
                return
            values[name] = evaluate_constant(value, values)
        except (ExpressionError, TypeError) as error:
            if name in table or not scope.parameter_flaws.found:
                flaws.add(
                    f"the parameter {quoted(name)} has no value in this case: {error}", *_at(name, table)
                )
            return


def _at(name: str, table: dict[str, Any]) -> tuple[str, ...]:
    return (name,) if name in table else ()


class CaseBounds(BoundTable):
    """Bounds of states that differ in a case; controls are common."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        flaws = Flaws()
        for name in object_of(value):
            if name in scope.controls:
                flaws.add(
                    f"the command is common to all cases, and so are the bounds of {quoted(name)}", name
                )
        flaws.raise_any()
        return super().check(value, scope)


class ScenarioSpec(SpecModel):
    """A plant: what differs from the document."""

    name: Annotated[str, CaseName(_LONGEST)]
    """Its name in the result."""
    parameters: Annotated[dict[str, Value], CaseParameters()] = Field(default_factory=dict)
    """Parameter -> its value in this case."""
    initial_state: Annotated[dict[str, BoundValue], BoundTable("state", star=True)] = Field(
        default_factory=dict
    )
    """State -> bound at t0 where it differs."""
    final_state: Annotated[dict[str, BoundValue], BoundTable("state", star=True)] = Field(
        default_factory=dict
    )
    """State -> bound at tf where it differs."""
    bounds: Annotated[dict[str, BoundValue], CaseBounds("state")] = Field(default_factory=dict)
    """State -> bound along the trajectory where it differs."""


class Choice(Check):
    """Whose objective is minimised."""

    def check(self, value: Any, scope: Scope) -> str | None:
        """Return the word."""
        if value is None:
            return None
        for word in ("nominal", "mean", "worst"):
            if value == word:
                return word
        raise refuse("must be 'nominal', 'mean' or 'worst'")

    def schema(self) -> dict[str, Any]:
        """One of three words."""
        return {"enum": ["nominal", "mean", "worst", None]}


class Scenarios(SpecModel):
    """Several plants under one command, with one final time and one design."""

    cases: Annotated[list[ScenarioSpec], at_most(MAX_CASES, "cases")]
    """The plants, up to 16."""
    nominal: bool = True
    """Whether the document without a case is a plant too."""
    objective: Annotated[Literal["nominal", "mean", "worst"] | None, Choice()] = None
    """Whose objective is minimised; ``nominal`` where that is a plant, else ``mean``."""

    @property
    def count(self) -> int:
        """The number of plants."""
        return len(self.cases) + self.nominal

    @property
    def choice(self) -> str:
        """The objective that is chosen."""
        return self.objective or ("nominal" if self.nominal else "mean")


def check_cases(scope: Scope, flaws: Flaws) -> None:
    """Names given twice, no plant at all, the objective of a plant that is not there."""
    scenarios = mapping(scope.problem.get("scenarios"))
    place = ("problem", "scenarios")
    nominal, cases = scenarios.get("nominal", True), scenarios.get("cases")
    seen: set[str] = set()
    for index, case in enumerate(cases[:MAX_CASES] if isinstance(cases, list) else ()):
        name = mapping(case).get("name")
        if isinstance(name, str):
            if name in seen:
                flaws.add(
                    f"the name {quoted(name)} is already taken by a case", *place, "cases", index, "name"
                )
            seen.add(name)
    if cases == []:
        flaws.add("at least one case is needed", *place, "cases")
    if scenarios.get("objective") == "nominal" and nominal is False:
        flaws.add("'nominal' is no plant here: 'nominal' is false", *place, "objective")
