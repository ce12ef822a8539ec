"""From pydantic's errors to faults in own words, with pointers into the document as submitted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from solvers.errors import Fault
from solvers.expressions import quoted
from solvers.spec.base import SpecModel
from solvers.spec.faults import Path, kind_of, pointer
from solvers.spec.job import JobSpec, Options, Output, Verification
from solvers.spec.methods import METHODS, SplineAdaptivity
from solvers.spec.modal import Mode
from solvers.spec.models import FirstOrderModel, LibraryReference, MechanicalModel, ModalModel
from solvers.spec.problem import (
    BoundaryConstraint,
    DesignSpec,
    Guess,
    Integral,
    NamedOutput,
    Objective,
    PathConstraint,
    ProblemSpec,
)
from solvers.spec.scope import Scope
from solvers.spec.webhook import Webhook

_KINDS: dict[str, type[SpecModel]] = {
    "mechanical": MechanicalModel,
    "modal": ModalModel,
    "first_order": FirstOrderModel,
    "library": LibraryReference,
}
# The last of these words on the way to a key tells which object the key belongs to.
_OBJECTS: dict[str, type[SpecModel]] = {
    **_KINDS,
    **METHODS,
    "problem": ProblemSpec,
    "path_constraints": PathConstraint,
    "boundary_constraints": BoundaryConstraint,
    "objective": Objective,
    "outputs": NamedOutput,
    "integrals": Integral,
    "design": DesignSpec,
    "modes": Mode,
    "guess": Guess,
    "options": Options,
    "verification": Verification,
    "output": Output,
    "webhook": Webhook,
    "adaptive": SplineAdaptivity,
}
_LATER = {"ga", "piecewise"}


def translate(error: ValidationError, scope: Scope) -> Iterator[Fault]:
    """Yield one fault for every mistake that pydantic found."""
    for detail in error.errors(include_url=False, include_input=True):
        yield from _faults(detail, scope)


def _faults(error: ErrorDetails, scope: Scope) -> Iterator[Fault]:
    tagged = error["loc"]
    loc = _without_tags(tagged)
    context: dict[str, Any] = error.get("ctx", {})
    if error["type"] == "flaws":
        for path, detail, kind in context["flaws"]:
            yield Fault(pointer(loc + path), detail, kind)
    elif error["type"] == "extra_forbidden":
        key = str(tagged[-1])
        owner = next((_OBJECTS[p] for p in reversed(tagged[:-1]) if p in _OBJECTS), JobSpec)
        keys = [info.alias or name for name, info in owner.model_fields.items()]
        yield Fault(pointer(loc), f"unknown key {quoted(key)}{scope.suggest(key, keys)}")
    elif error["type"] in ("union_tag_invalid", "union_tag_not_found"):
        yield _tag_fault(loc, error["input"], scope)
    else:
        yield Fault(pointer(loc), _sentence(error))


def _without_tags(loc: Path) -> Path:
    """Return the way without the names that pydantic adds for the kind of model and the method."""
    if loc[:2] == ("problem", "model"):
        return loc[:2] + loc[3:]
    return loc[:1] + loc[2:] if loc[:1] == ("method",) else loc


def _tag_fault(loc: Path, value: Any, scope: Scope) -> Fault:
    key, known = ("kind", list(_KINDS)) if loc[-1] == "model" else ("name", list(METHODS))
    place = pointer((*loc, key))
    tag = value.get(key) if isinstance(value, dict) else None
    choice = "one of " + ", ".join(known)
    if tag is None:
        return Fault(place, f"is required: {choice}")
    if not isinstance(tag, str):
        return Fault(place, f"must be {choice}, not {kind_of(tag)}")
    what = "method" if key == "name" else "kind of model"
    if tag in _LATER:
        return Fault(
            place, f"unsupported: the {what} '{tag}' is not in this version; {choice}", "unsupported"
        )
    return Fault(place, f"unknown {what} {quoted(tag)}{scope.suggest(tag, known)}; must be {choice}")


def _sentence(error: ErrorDetails) -> str:
    found = kind_of(error["input"])
    match error["type"]:
        case "missing":
            return "is required"
        case "model_type" | "model_attributes_type" | "dict_type":
            return f"must be an object, not {found}"
        case "list_type":
            return f"must be a list, not {found}"
        case "invalid_key":
            return "a key must be text"
        case _:
            return error["msg"]
