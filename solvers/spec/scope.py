"""What a document names, read before its fields are checked.

The reader takes what it understands of any JSON value and leaves the rest to the checks of the fields, which
ask the scope which names they may use and what constants are worth. So one pass reports every mistake.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from solvers.errors import ExpressionError
from solvers.expressions import (
    Code,
    Expression,
    ExpressionLimitError,
    did_you_mean,
    parse,
    quoted,
    unknown_function,
)
from solvers.models import LIBRARY
from solvers.spec.faults import Flaws, kind_of
from solvers.spec.values import evaluate_constant

MAX_STATES = 64
MAX_CONTROLS = 32
MAX_NAME = 200
VIBRATION_ENERGY = "vibration_energy"
"""The output that a model with elastic coordinates has by itself."""
# Bounds on the time that hostile documents can cost.
_SUGGESTIONS = 20
_LARGEST_POOL = 200
# Operations with definitions written out double with every definition: no need to know how many.
_BEYOND_COUNT = 1_000_000_000


@dataclass(slots=True)
class Scope:
    """The names of a document and the values of its parameters.

    ``known`` is False where the model could not be read: then names are not judged, because every one of
    them would look unknown. ``parameters`` holds those that have a value; ``parameter_names`` all of them.
    """

    document: dict[str, Any]
    problem: dict[str, Any]
    model: dict[str, Any]
    known: bool = False
    coordinates: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    controls: tuple[str, ...] = ()
    rated: tuple[str, ...] = ()
    parameters: dict[str, float] = field(default_factory=dict)
    parameter_names: frozenset[str] = frozenset()
    positive: tuple[str, ...] = ()
    parameter_intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    parameter_flaws: Flaws = field(default_factory=Flaws)
    computed_names: frozenset[str] = frozenset()
    definition_sizes: dict[str, int] = field(default_factory=dict)
    output_names: frozenset[str] = frozenset()
    model_names: frozenset[str] = frozenset()
    designed: frozenset[str] = frozenset()
    table_names: frozenset[str] = frozenset()
    integral_names: frozenset[str] = frozenset()
    path_names: frozenset[str] = frozenset()
    boundary_names: frozenset[str] = frozenset()
    rate_names: frozenset[str] = frozenset()
    suggestions: int = _SUGGESTIONS

    def suggest(self, word: str, candidates: Collection[str]) -> str:
        """Return ``"; did you mean ...?"``; only for 20 mistakes of a document and among 200 names."""
        if self.suggestions == 0 or len(candidates) > _LARGEST_POOL:
            return ""
        self.suggestions -= 1
        return did_you_mean(word, sorted(candidates))

    def names(self, place: str) -> frozenset[str]:
        """Return the names that an expression at ``place`` (constant, model, path or boundary) may use."""
        if place == "constant":
            return self.parameter_names - self.designed if self.designed else self.parameter_names
        if place == "parameter":
            return self.parameter_names
        if place == "path":
            return self.path_names
        return self.boundary_names if place == "boundary" else self.model_names

    def expanded(self, expression: Expression) -> int:
        """Return the number of operations of an expression with all definitions written out."""
        sizes = self.definition_sizes
        if not sizes:
            return expression.operations
        inner = (sizes.get(payload, 0) for code, payload in expression.program if code == Code.NAME)
        return min(expression.operations + sum(inner), _BEYOND_COUNT)


def mapping(value: object) -> dict[str, Any]:
    """Return ``value`` if it is an object, else an empty one."""
    return value if isinstance(value, dict) else {}


def read_scope(document: dict[str, Any]) -> Scope:
    """Read what names a document holds; never raises, whatever the document is."""
    problem = mapping(document.get("problem"))
    scope = Scope(document, problem, mapping(problem.get("model")))
    read_model(scope)
    return scope


def read_model(scope: Scope) -> None:
    """Fill in the names of ``scope.model``; a model of the library is replaced by its equations."""
    overrides: dict[str, Any] = {}
    if scope.model.get("kind") == "library":
        name = scope.model.get("name")
        entry = LIBRARY.get(name) if isinstance(name, str) else None
        if entry is None:
            return
        entry = entry.with_options(mapping(scope.model.get("options")))
        overrides = mapping(scope.model.get("parameters"))
        scope.positive = entry.positive
        scope.model = entry.document(overrides)
        scope.computed_names = frozenset(entry.computed)
        intervals = {name: parameter.interval for name, parameter in entry.parameters.items()}
        scope.parameter_intervals = {name: bounds for name, bounds in intervals.items() if bounds is not None}
    model = scope.model
    table = mapping(model.get("parameters"))
    scope.parameter_names = frozenset(table)
    scope.table_names |= frozenset(mapping(scope.problem.get("data")))
    scope.designed = _designed(table, mapping(scope.problem.get("design")))
    kind = model.get("kind")
    if kind in ("mechanical", "modal"):
        if kind == "modal":
            scope.axes = _name_list(model.get("axes")) or ()
            coordinates = _modal_coordinates(scope.axes, model.get("modes"))
        else:
            coordinates = _name_list(model.get("coordinates"))
        states = None if coordinates is None else coordinates + tuple(f"{q}_dot" for q in coordinates)
        scope.coordinates = coordinates or ()
    else:
        states = _name_list(model.get("states")) if kind == "first_order" else None
    controls = _name_list(model.get("controls"))
    if states is not None and controls is not None:
        scope.known = True
        scope.states, scope.controls = states, controls
        _read_names(scope)
    _read_parameters(scope, table)


def _read_names(scope: Scope) -> None:
    definitions = _read_definitions(scope) | scope.computed_names
    accelerations = frozenset(f"{q}_ddot" for q in scope.coordinates)
    ends = {f"{name}{end}" for name in scope.states + scope.controls for end in ("_0", "_f")}
    scope.integral_names = frozenset(_named(scope.problem.get("integrals")))
    outputs = _named(scope.problem.get("outputs"))
    outputs += [VIBRATION_ENERGY] if has_elastic_coordinates(scope) else []
    ends |= {f"{name}_f" for name in outputs}
    scope.output_names = frozenset(outputs)
    scope.rate_names = accelerations.union(f"{u}_dot" for u in scope.controls)
    scope.model_names = scope.parameter_names.union(scope.states, scope.controls, ("t",), definitions)
    scope.model_names |= scope.table_names
    rated = mapping(scope.problem.get("control_rates"))
    scope.rated = tuple(name for name in scope.controls if name in rated)
    scope.path_names = scope.model_names.union(accelerations, (f"{u}_dot" for u in scope.rated))
    scope.boundary_names = scope.parameter_names.union(ends, ("t0", "tf"), scope.integral_names)


def has_elastic_coordinates(scope: Scope) -> bool:
    """Tell whether the model has coordinates that swing, so that it has a vibration energy."""
    return bool(scope.model.get("modes" if scope.model.get("kind") == "modal" else "flexible"))


def _modal_coordinates(axes: tuple[str, ...], modes: object) -> tuple[str, ...] | None:
    """Return axes and modes by name, or None where they cannot be read."""
    names = _named(modes)
    return (*axes, *names) if axes and isinstance(modes, list) and len(names) == len(modes) else None


def _designed(table: Mapping[str, Any], design: Collection[str]) -> frozenset[str]:
    """Return the parameters that are optimised, and those that follow from them."""
    found = {name for name in design if name in table}
    for name, value in table.items() if found else ():
        try:
            follows = bool(parse(value).names & found)
        except (ExpressionError, TypeError):
            follows = False  # reported where it stands
        if follows:
            found.add(name)
    return frozenset(found)


def _read_definitions(scope: Scope) -> set[str]:
    """Return the names of the definitions; notes how large each is with those before it written out."""
    table = mapping(scope.model.get("definitions"))
    for name, value in table.items():
        try:
            scope.definition_sizes[name] = scope.expanded(parse(value))
        except (ExpressionError, TypeError):
            scope.definition_sizes[name] = 0  # reported where it stands
    return set(table)


def _named(items: object) -> list[str]:
    names = [mapping(item).get("name") for item in items] if isinstance(items, list) else []
    return [name for name in names if isinstance(name, str)]


def _name_list(value: object) -> tuple[str, ...] | None:
    """Return a list of names, or None if it is not one that can be worked with."""
    if not isinstance(value, list) or len(value) > MAX_STATES:
        return None
    return tuple(value) if all(isinstance(name, str) for name in value) else None


def _read_parameters(scope: Scope, table: Mapping[str, Any]) -> None:
    """Evaluate the parameters in order; what is wrong with them is kept for the check of the table."""
    flaws, earlier = scope.parameter_flaws, set[str]()
    for name, value in table.items():
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            flaws.add(f"must be a number or an expression, not {kind_of(value)}", name)
        else:
            _read_parameter(scope, name, value, earlier)
        earlier.add(name)


def _read_parameter(scope: Scope, name: str, value: float | str, earlier: set[str]) -> None:
    flaws = scope.parameter_flaws
    try:
        expression = parse(value)
        for other in expression.called:
            flaws.add(unknown_function(other), name)
        for other in expression.undefined(earlier | expression.called):
            where = f" (at character {expression.positions[other] + 1})"
            if other in scope.parameter_names:
                flaws.add(f"{quoted(other)} comes later; a parameter may use earlier ones only{where}", name)
            elif other in scope.model_names or other in scope.boundary_names:
                what = "the names here are earlier parameters and constants"
                flaws.add(f"the name {quoted(other)} cannot be used here; {what}{where}", name)
            else:
                flaws.add(f"unknown name {quoted(other)}{scope.suggest(other, earlier)}{where}", name)
        if not expression.called and expression.names <= scope.parameters.keys():
            scope.parameters[name] = evaluate_constant(value, scope.parameters)
    except ExpressionError as error:
        flaws.add(str(error), name, type="limit" if isinstance(error, ExpressionLimitError) else "invalid")
