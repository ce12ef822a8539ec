"""A phase as a problem of its own: what it says itself, and what it takes from what stands beside ``phases``.

A phase without a model takes the common one, and with it everything that speaks of its names: bounds, rates,
path constraints, outputs, integrals, design parameters, units. A phase with a model of its own says all of
this itself. The initial state beside ``phases`` is that of the first phase, the final state that of the last.

Works on the objects of a document as submitted, and on those of a checked one alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from solvers.spec.base import SpecModel
from solvers.spec.faults import Path
from solvers.spec.scope import mapping
from solvers.spec.values import FREE, BoundValue, Interval

IntervalOf = Callable[[Any, Any], Interval | None]
"""The interval of a bound, in the parameters of a model; None where it cannot be judged."""

_EVERYWHERE = ("bounds", "control_rates", "units")
_AT_THE_BEGIN = ("initial_state", "initial_control")
_AT_THE_END = ("final_state", "final_control")
_TABLES = (*_EVERYWHERE, *_AT_THE_BEGIN, *_AT_THE_END)
_LISTS = ("path_constraints", "outputs", "integrals")
_NOTHING = {"terminal": 0}


def fields_of(value: object) -> dict[str, Any]:
    """Return the keys of an object of a document, submitted or checked; nothing of anything else."""
    if isinstance(value, SpecModel):
        return {info.alias or name: getattr(value, name) for name, info in type(value).model_fields.items()}
    return mapping(value)


@dataclass(frozen=True)
class PhaseView:
    """One of ``count`` phases, as it stands in the problem ``outer``."""

    outer: Mapping[str, Any]
    phase: Mapping[str, Any]
    index: int
    count: int

    @property
    def has_own_model(self) -> bool:
        """Whether the phase has a model of its own."""
        return self.phase.get("model") is not None

    @property
    def said(self) -> frozenset[str]:
        """The keys that the phase has itself."""
        return frozenset(key for key, value in self.phase.items() if value is not None)

    @property
    def model(self) -> Any:
        """The model of the phase, with the values that it gives to parameters."""
        model = self.phase["model"] if self.has_own_model else self.outer.get("model")
        given = fields_of(model)
        known, own = mapping(given.get("parameters")), mapping(self.phase.get("parameters"))
        if given.get("kind") != "library":  # which does not name all that it has
            own = {name: value for name, value in own.items() if name in known}
        parameters = {**known, **own}
        if not own or not given:
            return model
        return (
            model.changed(parameters=parameters)
            if isinstance(model, SpecModel)
            else {**given, "parameters": parameters}
        )

    def fields(self, start: BoundValue, end: BoundValue) -> dict[str, Any]:
        """Return the keys of the problem that this phase is, between times within these bounds."""
        shared = {} if self.has_own_model else self.outer
        merged: dict[str, Any] = {
            key: {**self._common(key), **mapping(self.phase.get(key))} for key in _TABLES
        }
        merged |= {
            key: [*_unbounded(key, listed(shared.get(key))), *listed(self.phase.get(key))] for key in _LISTS
        }
        attitude = self.phase.get("final_attitude")
        if attitude is None and self.index == self.count - 1:
            attitude = shared.get("final_attitude")
        if self.index:
            merged["initial_state"] = {"*": None, **merged["initial_state"]}
        return {
            **merged,
            "model": self.model,
            "initial_time": start,
            "final_time": end,
            "final_attitude": attitude,
            "boundary_constraints": listed(self.phase.get("boundary_constraints")),
            "design": mapping(shared.get("design")),
            "data": mapping(self.outer.get("data")),
            "objective": self.phase.get("objective") or _NOTHING,
            "guess": self.phase.get("guess"),
        }

    def located(self, path: Path) -> Path:
        """Return where in the document stands what is at ``path`` of the problem that this phase is."""
        if path[:1] != ("problem",) or len(path) == 1:
            return path
        key, rest, here = path[1], path[2:], ("problem", "phases", self.index)
        own = (*here, *path[1:])
        if key == "model":
            if rest[:1] == ("parameters",) and rest[1:2] and rest[1] in mapping(self.phase.get("parameters")):
                return (*here, *rest)
            return own if self.has_own_model else path
        if key in _LISTS and rest:
            before = 0 if self.has_own_model else len(listed(self.outer.get(key)))
            at = int(rest[0])
            return path if at < before else (*here, key, at - before, *rest[1:])
        if key in ("design", "data") or (key in _TABLES and self._is_common(str(key), rest)):
            return path
        said = self.phase.get(str(key)) is not None
        return own if said or self.has_own_model or key in _TABLES else path

    def _common(self, key: str) -> dict[str, Any]:
        """Return what a table beside ``phases`` says to this phase."""
        at_the_end = self.index == self.count - 1
        reaches = (key in _EVERYWHERE) or (self.index == 0 if key in _AT_THE_BEGIN else at_the_end)
        return mapping(self.outer.get(key)) if reaches and not self.has_own_model else {}

    def _is_common(self, key: str, rest: Path) -> bool:
        common = self._common(key)
        if not rest:
            return bool(common) or (self.index == 0 and key == "initial_state" and not self.has_own_model)
        return rest[0] not in mapping(self.phase.get(key)) and rest[0] in common


def phase_views(outer: Mapping[str, Any]) -> list[PhaseView]:
    """Return the phases of a problem."""
    phases = [fields_of(phase) for phase in listed(outer.get("phases"))]
    return [PhaseView(outer, phase, index, len(phases)) for index, phase in enumerate(phases)]


def phase_fields(views: Sequence[PhaseView], interval: IntervalOf) -> Iterator[dict[str, Any]]:
    """Yield the keys of the problem that each phase is.

    A phase ends when it says; the last one else when the flight does; others at any time before that.
    """
    if not views:
        return
    outer = views[0].outer
    start, end = (
        interval(outer.get(key, default), outer.get("model")) or FREE
        for key, default in (("initial_time", 0), ("final_time", None))
    )
    for view in views:
        model, last = view.model, view.index == view.count - 1
        own_start, own_end = (view.phase.get(key) for key in ("initial_time", "final_time"))
        if own_start is not None:
            start = interval(own_start, model) or FREE
        stop = end if last else (start[0], end[1])
        if own_end is not None:
            stop = interval(own_end, model) or FREE
        yield view.fields(
            _bound(start) if own_start is None else own_start, _bound(stop) if own_end is None else own_end
        )
        start = stop


def listed(value: object) -> list[Any]:
    """Return ``value`` if it is a list, else an empty one."""
    return value if isinstance(value, list) else []


def _bound(interval: Interval) -> BoundValue:
    lower, upper = interval
    if lower == upper:
        return lower
    return [lower if math.isfinite(lower) else None, upper if math.isfinite(upper) else None]


def _unbounded(key: str, items: list[Any]) -> list[Any]:
    """What bounds the integrals beside ``phases`` is their sum over all phases."""
    if key != "integrals":
        return items
    return [
        item.changed(bounds=None) if isinstance(item, SpecModel) else {**mapping(item), "bounds": None}
        for item in items
    ]
