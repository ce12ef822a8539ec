"""A sweep: one job document, and the values that some of its places take.

``{"document": {...}, "grid": {"/problem/model/parameters/k": [50, 100, 200]}, "zip": false}``: every key of
``grid`` is a JSON pointer into the document; its values are a list, or ``{"from", "to", "count", "scale"}``
with ``scale`` ``linear`` (default) or ``log``. The points are the product of all values, the last pointer
fastest, or with ``zip`` the first values of all pointers, the second values, and so on.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solvers.errors import DocumentError, ExpressionError, Fault, pointer
from solvers.expressions import did_you_mean, quoted
from solvers.spec.check import check_document
from solvers.spec.checks import is_number
from solvers.spec.faults import MAX_FAULTS, Flaws, kind_of
from solvers.spec.job import JobSpec
from solvers.spec.pointers import parse_pointer, with_value
from solvers.spec.values import evaluate_constant
from solvers.sweep_path import coordinates, path_through_grid, path_through_points

MAX_POINTS = 10_000
"""Most points of a sweep."""

_KEYS = ("document", "grid", "zip")
_RANGE_KEYS = ("from", "to", "count", "scale")
_SCALES = ("linear", "log")


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """A point: its values (one a pointer), where it stands in [0, 1]^axes, and its document, checked."""

    values: tuple[Any, ...]
    place: tuple[float, ...]
    document: dict[str, Any]
    spec: JobSpec


@dataclass(frozen=True, slots=True)
class SweepPlan:
    """A checked sweep: its points in the order of its table, and ``path``, in which order to solve them."""

    pointers: tuple[str, ...]
    points: tuple[SweepPoint, ...]
    path: tuple[int, ...]
    zipped: bool


@dataclass(frozen=True, slots=True)
class _Axis:
    """The values of one pointer; ``listed`` where they were written one by one."""

    text: str
    keys: tuple[str, ...]
    values: Sequence[Any]
    logarithmic: bool
    listed: bool


def check_sweep(body: object) -> SweepPlan:
    """Return the checked form of a sweep (what its JSON stood for).

    Raises DocumentError with every mistake: of the sweep itself, or else of the documents of its points, at
    the value that is to blame where it is one of the grid, at ``/document`` otherwise.
    """
    if not isinstance(body, dict):
        raise DocumentError([Fault("", f"a sweep is an object, not {kind_of(body)}")])
    flaws = Flaws()
    for key in body:
        if key not in _KEYS:
            flaws.add(f"unknown key {quoted(key)}{did_you_mean(key, _KEYS)}", key)
    if not isinstance(body.get("document"), dict):
        flaws.add(_required(body, "document", "must be a job document"), "document")
    if not isinstance(zipped := body.get("zip", False), bool):
        flaws.add(f"must be true or false, not {kind_of(zipped)}", "zip")
    axes = _axes(body, flaws)
    if not flaws.found:
        _check_together(axes, zipped, flaws)
    if not flaws.found:
        _check_places(body["document"], axes, flaws)
    if flaws.found:
        raise DocumentError(flaws.faults())
    return _plan(body["document"], axes, zipped)


def _required(body: Mapping[str, Any], key: str, what: str) -> str:
    return f"{what}, not {kind_of(body[key])}" if key in body else "is required"


def _axes(body: Mapping[str, Any], flaws: Flaws) -> list[_Axis]:
    grid = body.get("grid")
    if not isinstance(grid, dict) or not grid:
        what = "must be an object of JSON pointers with their values"
        flaws.add(what + ", not an empty one" if grid == {} else _required(body, "grid", what), "grid")
        return []
    axes = []
    for text, given in grid.items():
        try:
            keys = parse_pointer(text)
        except ValueError as error:
            flaws.add(str(error), "grid", text)
            continue
        if isinstance(given, list):
            if not given:
                flaws.add("must have at least one value", "grid", text)
            elif len(given) > MAX_POINTS:
                flaws.add(_too_many(len(given)), "grid", text, type="limit")
            else:
                axes.append(_Axis(text, keys, given, logarithmic=False, listed=True))
        elif isinstance(given, dict):
            values = _range(given, ("grid", text), flaws)
            if values is not None:
                log = given.get("scale") == "log"
                axes.append(_Axis(text, keys, values, logarithmic=log, listed=False))
        else:
            what = "must be a list of values or an object with from, to, count and scale"
            flaws.add(f"{what}, not {kind_of(given)}", "grid", text)
    return axes


def _range(given: Mapping[str, Any], where: tuple[str, str], flaws: Flaws) -> list[float] | None:
    before = len(flaws.found)
    for key in given:
        if key not in _RANGE_KEYS:
            flaws.add(f"unknown key {quoted(key)}{did_you_mean(key, _RANGE_KEYS)}", *where, key)
    start, stop = (_end(given, key, where, flaws) for key in ("from", "to"))
    count = given.get("count")
    if not is_number(count) or not float(count).is_integer() or count < 1:
        flaws.add(_required(given, "count", "must be a whole number of at least 1"), *where, "count")
    elif count > MAX_POINTS:
        flaws.add(_too_many(int(count)), *where, "count", type="limit")
    scale = given.get("scale", "linear")
    if scale not in _SCALES:
        flaws.add("must be 'linear' or 'log'", *where, "scale")
    if len(flaws.found) > before or start is None or stop is None or not is_number(count):
        return None
    if scale == "linear":
        return [float(value) for value in np.linspace(start, stop, int(count))]
    if not (start * stop > 0 and math.isfinite(start * stop)):
        flaws.add("on a logarithmic scale from and to must both be positive or both negative", *where)
        return None
    return [float(value) for value in np.geomspace(start, stop, int(count))]


def _end(given: Mapping[str, Any], key: str, where: tuple[str, str], flaws: Flaws) -> float | None:
    value = given.get(key)
    if not is_number(value) and not isinstance(value, str):
        flaws.add(_required(given, key, "must be a number or an expression in constants"), *where, key)
        return None
    try:
        return evaluate_constant(value, {})
    except ExpressionError as error:
        flaws.add(str(error), *where, key)
        return None


def _too_many(count: int) -> str:
    return f"limit: a sweep has at most {MAX_POINTS:,} points, not {count:,}"


def _check_together(axes: Sequence[_Axis], zipped: bool, flaws: Flaws) -> None:
    for first, second in itertools.permutations(axes, 2):
        if second.keys[: len(first.keys)] == first.keys and first is not second:
            flaws.add(f"lies inside {quoted(first.text)}, which is swept too", "grid", second.text)
    if zipped:
        for axis in axes[1:]:
            if len(axis.values) != len(axes[0].values):
                detail = f"with zip all have as many values as the first, {len(axes[0].values)}"
                flaws.add(f"{detail}, not {len(axis.values)}", "grid", axis.text)
    elif (count := math.prod(len(axis.values) for axis in axes)) > MAX_POINTS:
        flaws.add(_too_many(count), "grid", type="limit")


def _check_places(document: Any, axes: Sequence[_Axis], flaws: Flaws) -> None:
    for axis in axes:
        try:
            document = with_value(document, axis.keys, axis.values[0])
        except ValueError as error:
            flaws.add(f"is no place of the document: {error}", "grid", axis.text)


def _plan(document: dict[str, Any], axes: Sequence[_Axis], zipped: bool) -> SweepPlan:
    places = coordinates([axis.values for axis in axes], logarithmic=[axis.logarithmic for axis in axes])
    numbers = [range(len(axis.values)) for axis in axes]
    chosen = list(zip(*numbers, strict=True)) if zipped else list(itertools.product(*numbers))
    faults: dict[Fault, Fault] = {}
    points: list[SweepPoint] = []
    for number, choice in enumerate(chosen):
        changed: Any = document
        for axis, index in zip(axes, choice, strict=True):
            changed = with_value(changed, axis.keys, axis.values[index])
        try:
            spec = check_document(changed)
        except DocumentError as error:
            for fault in _blamed(error.faults, axes, choice):
                faults.setdefault(fault, _at_point(fault, number))
            if len(faults) >= MAX_FAULTS:
                break
            continue
        values = tuple(axis.values[index] for axis, index in zip(axes, choice, strict=True))
        place = tuple(float(where[index]) for where, index in zip(places, choice, strict=True))
        points.append(SweepPoint(values, place, changed, spec))
    if faults:
        raise DocumentError(list(faults.values())[:MAX_FAULTS])
    path = path_through_points(np.array([p.place for p in points])) if zipped else path_through_grid(places)
    return SweepPlan(tuple(axis.text for axis in axes), tuple(points), tuple(path), zipped)


def _blamed(faults: Sequence[Fault], axes: Sequence[_Axis], choice: Sequence[int]) -> Iterator[Fault]:
    """The faults of a point's document, at the places of the sweep that they come from."""
    for fault in faults:
        for axis, index in zip(axes, choice, strict=True):
            place = pointer(axis.keys)
            if fault.pointer == place or fault.pointer.startswith(f"{place}/"):
                where = ("grid", axis.text, index) if axis.listed else ("grid", axis.text)
                yield Fault(pointer(where) + fault.pointer.removeprefix(place), fault.detail, fault.type)
                break
        else:
            yield Fault(f"/document{fault.pointer}", fault.detail, fault.type)


def _at_point(fault: Fault, number: int) -> Fault:
    """A fault as it is told: with the number of its point, unless every point or a value is to blame."""
    if number == 0 or fault.pointer.startswith("/grid"):
        return fault
    return Fault(fault.pointer, f"{fault.detail} (at point {number} of the table, from 0)", fault.type)
