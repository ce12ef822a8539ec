"""What ``POST /v1/jobs/{id}/flights`` asks for: many flights of one answer, what is uncertain drawn anew."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from solvers.errors import DocumentError, Fault
from solvers.expressions import did_you_mean, quoted
from solvers.models import LIBRARY
from solvers.spec.base import SpecModel
from solvers.spec.check import check_document
from solvers.spec.checks import check_constant
from solvers.spec.command import CommandSpec
from solvers.spec.document import walk
from solvers.spec.faults import MAX_FAULTS, Flaws, kind_of
from solvers.spec.fields import VALUE_SCHEMA, Check, Choice, Count, Real, Text
from solvers.spec.job import JobSpec, TagList
from solvers.spec.methods import PiecewiseMethod
from solvers.spec.models import LibraryReference, written_out
from solvers.spec.phase_merge import fields_of, phase_views
from solvers.spec.phases import flown_names, flown_scopes
from solvers.spec.scope import Scope, read_scope
from solvers.spec.tables import object_of, unknown_key
from solvers.spec.translate import nested, translate

MAX_RUNS = 10_000
MAX_VALUES = 10_000
MAX_SEED = 2**53 - 1

_KINDS = ("uniform", "normal", "values")


@dataclass(frozen=True)
class Distribution:
    """Where a number is drawn from.

    ``numbers``: the ends of ``uniform``, mean and deviation of ``normal``, or ``values``, each as likely.
    """

    kind: str
    numbers: tuple[float, ...]


class DistributionTable(Check):
    """Name -> ``{"uniform": [low, high]}``, ``{"normal": [mean, deviation]}`` or ``{"values": [...]}``."""

    def __init__(self, what: Literal["parameter", "state"]) -> None:
        self._what = what

    def check(self, value: Any, scope: Scope) -> dict[str, Distribution]:
        """Return the distributions by name: of parameters of any phase, of states of the first one."""
        scopes = flown_scopes(scope)
        names = flown_names(scopes, "parameter_names") if self._what == "parameter" else scopes[0].states
        table, flaws, found = object_of(value), Flaws(), dict[str, Distribution]()
        for name, entry in table.items():
            if name not in names:
                flaws.add(unknown_key(name, self._what, names, scope), name)
            elif (read := _distribution(entry, scope, flaws, name)) is not None:
                found[name] = read
        flaws.raise_any()
        return found

    def schema(self) -> dict[str, Any]:
        """An object of objects with one key each."""
        pair = {"type": "array", "items": VALUE_SCHEMA, "minItems": 2, "maxItems": 2}
        shapes = {
            "uniform": pair,
            "normal": pair,
            "values": {"type": "array", "items": VALUE_SCHEMA, "minItems": 1, "maxItems": MAX_VALUES},
        }
        one_of = [
            {"type": "object", "properties": {kind: shape}, "required": [kind], "additionalProperties": False}
            for kind, shape in shapes.items()
        ]
        return {"type": "object", "additionalProperties": {"oneOf": one_of}}


def _distribution(entry: Any, scope: Scope, flaws: Flaws, name: str) -> Distribution | None:
    choice = "an object with one of the keys uniform, normal and values"
    if not isinstance(entry, dict) or len(entry) != 1:
        found = f"one with {len(entry)} keys" if isinstance(entry, dict) else kind_of(entry)
        flaws.add(f"must be {choice}, not {found}", name)
        return None
    ((kind, given),) = entry.items()
    if kind not in _KINDS:
        flaws.add(f"unknown distribution {quoted(kind)}{did_you_mean(kind, _KINDS)}", name, kind)
        return None
    if not isinstance(given, list) or not given or (kind != "values" and len(given) != 2):
        shapes = {"uniform": "[low, high]", "normal": "[mean, standard deviation]"}
        flaws.add(f"must be {shapes.get(kind, 'a list of at least one value')}", name, kind)
        return None
    if len(given) > MAX_VALUES:
        flaws.add(f"limit: at most {MAX_VALUES:,} values, not {len(given):,}", name, kind, type="limit")
        return None
    numbers = [check_constant(item, scope, flaws, name, kind, index) for index, item in enumerate(given)]
    known = [number for number in numbers if number is not None]
    if len(known) < len(numbers):
        return None
    if kind == "uniform" and known[0] > known[1]:
        flaws.add(f"crossed: the lower end {known[0]:g} is above the upper one {known[1]:g}", name, kind)
    elif kind == "normal" and known[1] < 0.0:
        flaws.add(f"a standard deviation must be at least 0, not {known[1]:g}", name, kind, 1)
    else:
        return Distribution(kind, tuple(known))
    return None


class ActuatorSpec(SpecModel):
    """What stands between a commanded control and the model."""

    lag: Annotated[float, Real(least=0)] = 0.0
    """Time constant of a first-order lag, which begins at zero."""
    delay: Annotated[float, Real(least=0, limit=1e6, unit=" s")] = 0.0
    """How much later a command takes effect; before that the control is zero."""


class ActuatorTable(Check):
    """Control -> its actuator."""

    def check(self, value: Any, scope: Scope) -> dict[str, ActuatorSpec]:
        """Return the actuators by control."""
        table, flaws, found = object_of(value), Flaws(), dict[str, ActuatorSpec]()
        controls = flown_names(flown_scopes(scope), "controls")
        for name, entry in table.items():
            if name not in controls:
                flaws.add(unknown_key(name, "control", controls, scope), name)
                continue
            own = Flaws()
            actuator = nested(ActuatorSpec, entry, scope, own)
            flaws.take(own, name)
            if actuator is not None:
                found[name] = actuator
        flaws.raise_any()
        return found

    def schema(self) -> dict[str, Any]:
        """An object of objects."""
        return {"type": "object", "additionalProperties": ActuatorSpec.model_json_schema()}


class FlightsSpec(SpecModel):
    """Checked flights of an answer; made by `check_flights`."""

    name: Annotated[str, Text(200)] = ""
    """A name for people."""
    tags: Annotated[list[str], TagList()] = Field(default_factory=list)
    """Words to find the job by."""
    runs: Annotated[int, Count(1, MAX_RUNS, "runs")] = 1000
    """How many flights."""
    seed: Annotated[int, Count(0, MAX_SEED, "as a seed")] = 0
    """The same seed draws the same numbers; those of a name do not depend on what else is drawn."""
    use: Annotated[Literal["command", "control"], Choice(("command", "control"))] = "control"
    """What is flown: the table of ``output.command``, or the control of the answer itself."""
    command: CommandSpec | None = None
    """Another table than that of the document's ``output.command``."""
    parameters: Annotated[dict[str, Distribution], DistributionTable("parameter")] = Field(
        default_factory=dict
    )
    """Parameter of the model -> where its value is drawn from; what follows from it follows."""
    initial_state: Annotated[dict[str, Distribution], DistributionTable("state")] = Field(
        default_factory=dict
    )
    """State -> where its value at t0 is drawn from: the value itself, not a deviation."""
    actuator: Annotated[dict[str, ActuatorSpec], ActuatorTable()] = Field(default_factory=dict)
    """Control -> the lag and the delay of its actuator."""
    coast: Annotated[float, Real(above=0, limit=1e6, unit=" s")] | None = None
    """Seconds to fly on without control."""
    actuator_after: Annotated[Literal["off", "decay"], Choice(("off", "decay"))] = "off"
    """At the end of the flight lagging actuators are switched ``off``, or what they give dies away."""
    tolerance: Annotated[float, Real(above=0)] = 1e-2
    """By how much of its scale a limit may be missed before that counts as a violation."""
    worst: Annotated[int, Count(0, 100, "worst flights")] = 5
    """How many of the worst flights are told with all that was drawn for them."""
    max_seconds: Annotated[float, Real(above=0, limit=3600, unit=" s")] = 60.0
    """Longest time of all flights together, s."""

    def resolved(self) -> dict[str, Any]:
        """Return what is asked for, with every default written out."""
        drawn = {
            key: {name: {item.kind: list(item.numbers)} for name, item in getattr(self, key).items()}
            for key in ("parameters", "initial_state")
        }
        tables = {"actuator": {name: item.model_dump() for name, item in self.actuator.items()}, **drawn}
        return {**self.model_dump(exclude={*tables}), **tables}

    def table(self, answered: JobSpec) -> CommandSpec | None:
        """Return how the table is made that is flown, None where the control itself is."""
        if self.use == "control":
            return None
        return self.command or answered.output.command


def check_flights(document: object, answered: Mapping[str, Any]) -> FlightsSpec:
    """Return the checked form of flights of the answer to the job document ``answered``, itself resolved.

    Raises DocumentError with every mistake at once; pointers are into ``document``.
    """
    flaws = Flaws()
    walk(document, flaws)
    if flaws.found:
        raise DocumentError(flaws.faults())
    if not isinstance(document, dict):
        raise DocumentError([Fault("", f"flights are asked for by an object, not by {kind_of(document)}")])
    job = check_document(answered)
    if reason := _not_flown(job):
        raise DocumentError([Fault("", reason, "unsupported")])
    scope = read_scope(dict(answered))
    spec: FlightsSpec | None = None
    faults: list[Fault] = []
    try:
        spec = FlightsSpec.model_validate(document, context=scope)
    except ValidationError as error:
        faults += islice(translate(error, scope, FlightsSpec), MAX_FAULTS)
    else:
        faults += _built_in(spec, job)
    if document.get("use") == "command" and not document.get("command") and job.output.command is None:
        detail = "the job has no output.command; say how the table is made in 'command', or use 'control'"
        faults.append(Fault("/use", detail))
    if spec is None or faults:
        raise DocumentError(dict.fromkeys(faults))
    return spec


def _built_in(spec: FlightsSpec, job: JobSpec) -> Iterator[Fault]:
    """The drawn parameters of which data tables are made: their numbers are the same for all flights."""
    views = phase_views(fields_of(job.problem))
    models = [written_out(view.model) for view in views] or [job.problem.model]
    for name in spec.parameters:
        changing = {name}.union(*(model.depending_on([name]) for model in models))
        for table, item in job.problem.tables().items():
            if not item.names.isdisjoint(changing):
                detail = f"unsupported: the data table {quoted(table)} is made of it"
                yield Fault(f"/parameters/{name}", detail, "unsupported")


def _not_flown(job: JobSpec) -> str | None:
    """Why answers to a job are not flown so, None where they are."""
    if isinstance(job.method, PiecewiseMethod):
        return "unsupported: flights of a mission in segments, whose control follows its plant"
    models = [job.problem.submitted_model, *(phase.submitted_model for phase in job.problem.phases)]
    for model in models:
        if isinstance(model, LibraryReference) and LIBRARY[model.name].computed:
            return f"unsupported: flights of the library model {quoted(model.name)}, which computes by tables"
    return None


def flights_schema() -> dict[str, Any]:
    """Return the JSON Schema of a request for flights."""
    return FlightsSpec.model_json_schema(by_alias=True)
