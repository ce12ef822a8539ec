"""From pydantic's errors to faults in own words, with pointers into the document as submitted."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from solvers.errors import Fault, pointer
from solvers.expressions import quoted
from solvers.spec.base import SpecModel
from solvers.spec.command import CommandSpec
from solvers.spec.faults import MAX_FAULTS, Flaw, Flaws, Path, kind_of
from solvers.spec.job import JobSpec, Options, Output, Verification
from solvers.spec.method_model import Adaptivity, SplineAdaptivity
from solvers.spec.methods import METHODS
from solvers.spec.modal import Mode
from solvers.spec.models import FirstOrderModel, LibraryReference, MechanicalModel, ModalModel
from solvers.spec.parts import (
    BoundaryConstraint,
    DesignSpec,
    Guess,
    Integral,
    NamedOutput,
    Objective,
    PathConstraint,
)
from solvers.spec.phases import LinkSpec, PhaseSpec
from solvers.spec.piecewise import Segments, Stop, Tracking
from solvers.spec.problem import ProblemSpec
from solvers.spec.scenarios import Scenarios, ScenarioSpec
from solvers.spec.scope import Scope
from solvers.spec.webhook import Webhook

Object = TypeVar("Object", bound=SpecModel)

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
    "scenarios": Scenarios,
    "cases": ScenarioSpec,
    "guess": Guess,
    "phases": PhaseSpec,
    "links": LinkSpec,
    "options": Options,
    "verification": Verification,
    "output": Output,
    "command": CommandSpec,
    "webhook": Webhook,
    "adaptive": Adaptivity,
    "segments": Segments,
    "stop": Stop,
    "tracking": Tracking,
}
_ADAPTIVE: dict[Path, type[SpecModel]] = {("swcm", "adaptive"): SplineAdaptivity}

_BESIDE_PHASES = {
    "model": "that of all phases without a model of their own",
    "final_time": "when the last phase ends, as a value or bounds, also where that phase says it itself",
    "initial_state": "where the first phase begins; {} where that has a model of its own",
    "objective": 'what counts over the whole flight; {"terminal": 0} where the phases say all of it',
}


def translate(error: ValidationError, scope: Scope, whole: type[SpecModel] = JobSpec) -> Iterator[Fault]:
    """Yield one fault for every mistake that pydantic found in a document that is a ``whole``."""
    for path, detail, kind in _flaws(error, scope, whole):
        yield Fault(pointer(path), detail, kind)


def nested(kind: type[Object], value: Any, scope: Scope, flaws: Flaws) -> Object | None:
    """Read an object of a document in a scope of its own; what is wrong with it is added to ``flaws``."""
    try:
        return kind.model_validate(value, context=scope)
    except ValidationError as error:
        flaws.found += islice(_flaws(error, scope, kind), MAX_FAULTS)
    return None


def _flaws(error: ValidationError, scope: Scope, whole: type[SpecModel] = JobSpec) -> Iterator[Flaw]:
    for detail in error.errors(include_url=False, include_input=True):
        yield from _flaws_of(detail, scope, whole)


def _flaws_of(error: ErrorDetails, scope: Scope, whole: type[SpecModel]) -> Iterator[Flaw]:
    tagged = error["loc"]
    loc = _without_tags(tagged)
    context: dict[str, Any] = error.get("ctx", {})
    if error["type"] == "flaws":
        for path, detail, kind in context["flaws"]:
            yield loc + path, detail, kind
    elif error["type"] == "extra_forbidden":
        key = str(tagged[-1])
        owner = _ADAPTIVE.get(tagged[1:-1]) or next(
            (_OBJECTS[p] for p in reversed(tagged[:-1]) if p in _OBJECTS), whole
        )
        keys = [info.alias or name for name, info in owner.model_fields.items()]
        yield loc, f"unknown key {quoted(key)}{scope.suggest(key, keys)}", "invalid"
    elif error["type"] in ("union_tag_invalid", "union_tag_not_found"):
        yield _tag_flaw(loc, error["input"], scope)
    elif error["type"] == "missing" and loc[:-1] == ("problem",) and scope.problem.get("phases"):
        yield loc, f"is required beside phases too: {_BESIDE_PHASES[str(loc[-1])]}", "invalid"
    else:
        yield loc, _sentence(error), "invalid"


def _without_tags(loc: Path) -> Path:
    """Return the way without the names that pydantic adds for the kind of model and the method."""
    if loc[:2] == ("problem", "model"):
        return loc[:2] + loc[3:]
    return loc[:1] + loc[2:] if loc[:1] in (("method",), ("model",)) else loc


def _tag_flaw(loc: Path, value: Any, scope: Scope) -> Flaw:
    key, known = ("kind", list(_KINDS)) if loc[-1] == "model" else ("name", list(METHODS))
    place = (*loc, key)
    tag = value.get(key) if isinstance(value, dict) else None
    choice = "one of " + ", ".join(known)
    if tag is None:
        return place, f"is required: {choice}", "invalid"
    if not isinstance(tag, str):
        return place, f"must be {choice}, not {kind_of(tag)}", "invalid"
    what = "method" if key == "name" else "kind of model"
    return place, f"unknown {what} {quoted(tag)}{scope.suggest(tag, known)}; must be {choice}", "invalid"


def _sentence(error: ErrorDetails) -> str:
    found = kind_of(error["input"])
    match error["type"]:
        case "missing":
            return "is required"
        case "model_type" | "model_attributes_type" | "dict_type":
            return f"must be an object, not {found}"
        case "list_type":
            return f"must be a list, not {found}"
        case "bool_type" | "bool_parsing":
            return f"must be true or false, not {found}"
        case "invalid_key":
            return "a key must be text"
        case _:
            return error["msg"]
