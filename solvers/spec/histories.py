"""The lists of an initial guess: values over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from solvers.spec.checks import check_constant
from solvers.spec.faults import Flaws, kind_of, refuse
from solvers.spec.fields import VALUE_SCHEMA, Check
from solvers.spec.scope import Scope
from solvers.spec.tables import list_of, object_of, unknown_key

MAX_GUESS = 8195


@dataclass(frozen=True)
class HistoryTable(Check):
    """Name -> values over time: a list, or ``{"times": [...], "values": [...]}``."""

    what: str

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the table as submitted."""
        table, flaws = object_of(value), Flaws()
        names = scope.states if self.what == "state" else scope.controls
        for name, history in table.items():
            if scope.known and name not in names:
                flaws.add(unknown_key(name, self.what, names, scope), name)
            elif isinstance(history, dict):
                self._check_timed(history, scope, flaws, name)
            else:
                check_values(history, scope, flaws, name)
        flaws.raise_any()
        return table

    def _check_timed(self, history: dict[str, Any], scope: Scope, flaws: Flaws, name: str) -> None:
        for key in history:
            if key not in ("times", "values"):
                flaws.add(unknown_key(key, "key", ("times", "values"), scope), name, key)
            elif key == "times":
                check_times(history[key], scope, flaws, name, key)
            else:
                check_values(history[key], scope, flaws, name, key)
        times, values = history.get("times"), history.get("values")
        if times is None or values is None:
            flaws.add("both 'times' and 'values' are needed", name)
        if isinstance(times, list) and isinstance(values, list) and len(times) != len(values):
            flaws.add(f"{len(times)} times for {len(values)} values", name)

    def schema(self) -> dict[str, Any]:
        """An object of lists."""
        values = TimeList().schema()
        timed: dict[str, Any] = {"type": "object", "properties": {"times": values, "values": values}}
        timed |= {"required": ["times", "values"], "additionalProperties": False}
        return {"type": "object", "additionalProperties": {"anyOf": [values, timed]}}


def check_values(
    value: Any, scope: Scope, flaws: Flaws, *path: str | int, gaps: bool = False
) -> list[float | None]:
    """Check a list of 1 to 8,195 values, or nulls where there may be ``gaps``; return what they are worth."""
    if not isinstance(value, list):
        flaws.add(f"must be a list of values, not {kind_of(value)}", *path)
    elif not value:
        flaws.add("at least one value is needed", *path)
    elif len(value) > MAX_GUESS:
        flaws.add(f"limit: a guess has at most {MAX_GUESS:,} values, not {len(value):,}", *path, type="limit")
    else:
        return [
            None if item is None and gaps else check_constant(item, scope, flaws, *path, i)
            for i, item in enumerate(value)
        ]
    return []


def check_times(value: Any, scope: Scope, flaws: Flaws, *path: str | int, meetings: bool = False) -> bool:
    """Check a list of ascending times; return whether phases meet among them.

    Where there may be ``meetings`` a time stands twice in a row, between others.
    """
    times, met = check_values(value, scope, flaws, *path), False
    for i in range(1, len(times)):
        before, after = times[i - 1], times[i]
        if before is None or after is None or after > before:
            continue
        if not (meetings and after == before and 1 < i < len(times) - 1 and times[i - 2] != before):
            flaws.add(f"times ascend, but {after:g} comes after {before:g}", *path, i)
            break
        met = True
    return met


class TimeList(Check):
    """Ascending times of a guess."""

    def check(self, value: Any, scope: Scope) -> list[Any]:
        """Return the times as submitted."""
        flaws = Flaws()
        times = list_of(value)
        check_times(times, scope, flaws)
        flaws.raise_any()
        return times

    def schema(self) -> dict[str, Any]:
        """A list of values."""
        return {"type": "array", "items": VALUE_SCHEMA, "minItems": 1, "maxItems": MAX_GUESS}


class ResultNodes(Check):
    """The ``nodes`` of a result: ``t`` and, over it, states and controls; what else they hold is not read.

    Where phases meet a time stands twice, and what a phase does not have is null there.
    """

    def check(self, value: Any, scope: Scope) -> dict[str, Any]:
        """Return the nodes as submitted."""
        from solvers.spec.phases import flown_scopes  # which knows every object of a phase, this one too

        nodes, flaws = object_of(value), Flaws()
        times = nodes.get("t")
        if not isinstance(times, list) or len(times) < 2:
            raise refuse("must be the 'nodes' of a result: its list 't' of two times or more is missing")
        met = check_times(times, scope, flaws, "t", meetings=True)
        scopes = flown_scopes(scope)
        for group, names in (
            ("states", [name for own in scopes for name in own.states + own.rated]),
            (
                "controls",
                [name for own in scopes for name in (*own.controls, *(f"{rate}_dot" for rate in own.rated))],
            ),
        ):
            table = nodes.get(group, {})
            if not isinstance(table, dict):
                flaws.add(f"must be an object of lists, not {kind_of(table)}", group)
                continue
            for name, values in table.items():
                if scope.known and name not in names:
                    flaws.add(unknown_key(name, group[:-1], names, scope), group, name)
                elif len(check_values(values, scope, flaws, group, name, gaps=met)) not in (0, len(times)):
                    flaws.add(f"{len(times)} times for {len(values)} values", group, name)
        flaws.raise_any()
        return nodes

    def schema(self) -> dict[str, Any]:
        """An object with times, states and controls."""
        lists = {"type": "object", "additionalProperties": {"type": "array", "items": VALUE_SCHEMA}}
        properties = {"t": TimeList().schema(), "states": lists, "controls": lists}
        return {"type": "object", "properties": properties, "required": ["t"]}
