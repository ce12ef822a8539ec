"""The types of the fields of a document: each checks itself against the scope while pydantic reads it.

A check is put into an annotation, as in ``Annotated[float, Real(above=0)]``; it needs a `Scope` as pydantic
context, which `solvers.spec.check_document` provides.
"""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from solvers.expressions import MAX_CHARACTERS, quoted
from solvers.spec.checks import check_bound, check_constant, check_expression, is_number
from solvers.spec.faults import Flaws, kind_of, refuse
from solvers.spec.scope import Scope
from solvers.spec.values import Value

VALUE_SCHEMA: dict[str, Any] = {
    "anyOf": [{"type": "number"}, {"type": "string", "maxLength": MAX_CHARACTERS}],
}
_ROUNDING = 1e-12
_SIDE = {"anyOf": [*VALUE_SCHEMA["anyOf"], {"type": "null"}]}
BOUND_SCHEMA: dict[str, Any] = {
    "anyOf": [*VALUE_SCHEMA["anyOf"], {"type": "array", "items": _SIDE, "minItems": 2, "maxItems": 2}],
}


class Check:
    """A check of one field; subclasses say what is right (`check`) and how that is written (`schema`)."""

    def check(self, value: Any, scope: Scope) -> Any:
        """Return what the field shall hold; raises PydanticCustomError with every flaw of the value."""
        raise NotImplementedError

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the field."""
        raise NotImplementedError

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        def validate(value: Any, info: core_schema.ValidationInfo[Any]) -> Any:
            return self.check(value, info.context)

        return core_schema.with_info_plain_validator_function(validate)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return deepcopy(self.schema())  # pydantic writes into it


class ShapedCheck(Check):
    """A check of a field whose JSON Schema is that of its type."""

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        def validate(value: Any, info: core_schema.ValidationInfo[Any]) -> Any:
            return self.check(value, info.context)

        shape = handler(source)
        return core_schema.with_info_plain_validator_function(validate, json_schema_input_schema=shape)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return handler(core)


class Flag(Check):
    """True, or nothing: false asks for nothing."""

    def check(self, value: Any, scope: Scope) -> bool | None:
        """Return True or None."""
        if value is not None and not isinstance(value, bool):
            raise refuse(f"must be true or false, not {kind_of(value)}")
        return value or None

    def schema(self) -> dict[str, Any]:
        """A boolean."""
        return {"type": "boolean"}


@dataclass(frozen=True)
class Text(Check):
    """Text of at most ``longest`` characters."""

    longest: int | None = None

    def check(self, value: Any, scope: Scope) -> str:
        """Return the text."""
        if not isinstance(value, str):
            raise refuse(f"must be text, not {kind_of(value)}")
        if self.longest is not None and len(value) > self.longest:
            raise refuse(f"limit: at most {self.longest} characters, not {len(value):,}", type="limit")
        return value

    def schema(self) -> dict[str, Any]:
        """Text with its greatest length."""
        return {"type": "string"} | ({} if self.longest is None else {"maxLength": self.longest})


@dataclass(frozen=True)
class Real(Check):
    """A number, or a constant expression that is replaced by its value; ``above`` is exclusive."""

    above: float | None = None
    limit: float | None = None
    unit: str = ""
    least: float | None = None

    def check(self, value: Any, scope: Scope) -> float | None:
        """Return the number."""
        flaws = Flaws()
        number = check_constant(value, scope, flaws)
        if number is not None and self.least is not None and number < self.least:
            flaws.add(f"must be at least {self.least:g}, not {number:g}")
        if number is not None and self.above is not None and number <= self.above:
            flaws.add(f"must be greater than {self.above:g}, not {number:g}")
        if number is not None and self.limit is not None and number > self.limit:
            flaws.add(f"limit: at most {self.limit:,.10g}{self.unit}, not {number:,g}", type="limit")
        flaws.raise_any()
        return number

    def schema(self) -> dict[str, Any]:
        """A number or an expression."""
        number: dict[str, Any] = {"type": "number"}
        if self.above is not None:
            number["exclusiveMinimum"] = self.above
        if self.least is not None:
            number["minimum"] = self.least
        if self.limit is not None:
            number["maximum"] = self.limit
        return {"anyOf": [number, VALUE_SCHEMA["anyOf"][1]]}


@dataclass(frozen=True)
class Count(Check):
    """A whole number of ``things`` from ``least`` to ``limit``, or an expression that is worth one."""

    least: int
    limit: int
    things: str

    def check(self, value: Any, scope: Scope) -> int:
        """Return the integer."""
        if isinstance(value, str):
            flaws = Flaws()
            value = check_constant(value, scope, flaws)
            flaws.raise_any()
            if value is None:
                return self.least  # what it names is at fault, and reported there
            # An expression may miss what it is worth by roundings.
            value = round(value) if math.isclose(value, round(value), rel_tol=_ROUNDING) else value
        if not is_number(value):
            raise refuse(f"must be a whole number, not {kind_of(value)}")
        if not float(value).is_integer():
            raise refuse(f"must be a whole number, not {value:g}")
        if value < self.least:
            raise refuse(f"must be at least {self.least}, not {value:g}")
        if value > self.limit:
            raise refuse(f"limit: at most {self.limit:,} {self.things}, not {value:,g}", type="limit")
        return int(value)

    def schema(self) -> dict[str, Any]:
        """An integer or an expression."""
        number = {"type": "integer", "minimum": self.least, "maximum": self.limit}
        return {"anyOf": [number, VALUE_SCHEMA["anyOf"][1]]}


@dataclass(frozen=True)
class Choice(Check):
    """One of some words, or one of the other values that stand beside them: ``None``, ``False``."""

    words: tuple[str, ...]
    others: tuple[bool | None, ...] = ()

    def check(self, value: Any, scope: Scope) -> str | bool | None:
        """Return the word."""
        if isinstance(value, str) and value in self.words:
            return value
        if any(value is other for other in self.others):
            return None if value is None else bool(value)
        choice = ", ".join(f"'{word}'" for word in self.words)
        others = "".join(f" or {_WRITTEN[other]}" for other in self.others)
        choice = f"{choice}{others}" if others else f"one of {choice}"
        if not isinstance(value, str):
            raise refuse(f"must be {choice}, not {kind_of(value)}")
        raise refuse(f"must be {choice}, not {quoted(value)}{scope.suggest(value, self.words)}")

    def schema(self) -> dict[str, Any]:
        """The values."""
        words: dict[str, Any] = {"enum": [*self.words, *self.others]}
        return words if self.others else {"type": "string", **words}


_WRITTEN = {None: "null", False: "false", True: "true"}


@dataclass(frozen=True)
class ExpressionIn(Check):
    """An expression in the names of a place: constant, model, path or boundary."""

    place: str

    def check(self, value: Any, scope: Scope) -> Any:
        """Return the expression as submitted."""
        flaws = Flaws()
        check_expression(value, self.place, scope, flaws)
        flaws.raise_any()
        return value

    def schema(self) -> dict[str, Any]:
        """A number or an expression."""
        return VALUE_SCHEMA


class ConstantCheck(Check):
    """A number, or an expression in parameters that has a finite value."""

    def check(self, value: Any, scope: Scope) -> Any:
        """Return the constant as submitted."""
        flaws = Flaws()
        check_constant(value, scope, flaws)
        flaws.raise_any()
        return value

    def schema(self) -> dict[str, Any]:
        """A number or an expression."""
        return VALUE_SCHEMA


class BoundCheck(Check):
    """A value (equal to) or ``[lower, upper]``, either side ``null`` for none."""

    def check(self, value: Any, scope: Scope) -> Any:
        """Return the bound as submitted."""
        flaws = Flaws()
        check_bound(value, scope, flaws)
        flaws.raise_any()
        return value

    def schema(self) -> dict[str, Any]:
        """A value or a pair."""
        return BOUND_SCHEMA


class Window(Check):
    """A part of the time span: ``[start, end]`` with 0 <= start <= end <= 1."""

    def check(self, value: Any, scope: Scope) -> list[Any]:
        """Return the window as submitted."""
        if not isinstance(value, list) or len(value) != 2:
            raise refuse("must be [start, end], counted from 0 at t0 to 1 at tf")
        flaws = Flaws()
        start, stop = (check_constant(side, scope, flaws, index) for index, side in enumerate(value))
        if start is not None and stop is not None and not 0.0 <= start <= stop <= 1.0:
            flaws.add(f"must satisfy 0 <= start <= end <= 1, not {start:g}, {stop:g}")
        flaws.raise_any()
        return value

    def schema(self) -> dict[str, Any]:
        """A pair of values."""
        return {"type": "array", "items": VALUE_SCHEMA, "minItems": 2, "maxItems": 2}


def at_most(count: int, things: str) -> BeforeValidator:
    """Refuse a longer list before its entries are read."""

    def few(value: Any) -> Any:
        if isinstance(value, list) and len(value) > count:
            raise refuse(f"limit: at most {count:,} {things}, not {len(value):,}", type="limit")
        return value

    return BeforeValidator(few)


class FreeObject(Check):
    """An object that the service keeps and hands back, but does not read."""

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the object."""
        if not isinstance(value, dict):
            raise refuse(f"must be an object, not {kind_of(value)}")
        return value

    def schema(self) -> dict[str, Any]:
        """Any object."""
        return {"type": "object"}


Bound = Annotated[Value | list[Value | None], BoundCheck()]
PathExpression = Annotated[Value, ExpressionIn("path")]
BoundaryExpression = Annotated[Value, ExpressionIn("boundary")]
