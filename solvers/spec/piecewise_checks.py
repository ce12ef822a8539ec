"""What the ``piecewise`` method asks of the whole document: a start, segments, an end."""

from __future__ import annotations

from typing import Any

import numpy as np

from solvers.errors import ExpressionError
from solvers.expressions import parse, quoted
from solvers.spec.checks import check_bound, interval_of
from solvers.spec.faults import Flaws
from solvers.spec.scope import Scope, mapping
from solvers.spec.values import FREE, Interval, evaluate_constant

MOST_SEGMENTS = 10_000


def check_piecewise(scope: Scope, flaws: Flaws) -> None:
    """Note what keeps a document with this method from being flown; others are passed over."""
    method = mapping(scope.document.get("method"))
    if method.get("name") != "piecewise":
        return
    if not scope.known:
        return
    if not _fixed(interval_of(scope, scope.problem.get("initial_time", 0))):
        flaws.add("piecewise starts at one time: give a value", "problem", "initial_time")
    initial = mapping(scope.problem.get("initial_state"))
    for state in scope.states:
        place = state if state in initial else "*"
        if place in initial and not _fixed(interval_of(scope, initial[place])):
            flaws.add(
                f"piecewise starts from one state: give {quoted(state)} a value",
                "problem",
                "initial_state",
                place,
            )
    _check_segments(scope, method, flaws)
    _check_stop(scope, mapping(method.get("stop")), flaws)


def _check_stop(scope: Scope, stop: dict[str, Any], flaws: Flaws) -> None:
    """A stop that is met where the mission begins; what controls and outputs are there is not known yet."""
    expression, start = stop.get("expression"), _start(scope)
    if stop.get("average") or not isinstance(expression, str) or start is None:
        return
    try:
        if not parse(expression).names <= start.keys():
            return
        value = evaluate_constant(expression, start)
    except ExpressionError:
        return  # reported where it stands, or not a number there
    bounds = check_bound(stop.get("bounds"), scope, Flaws())
    if bounds is not None and bounds[0] <= value <= bounds[1]:
        detail = f"is met at the start, where the expression is {value:g}: the mission would be over"
        flaws.add(detail, "method", "stop")


def _start(scope: Scope) -> dict[str, float] | None:
    """What a boundary constraint knows at the start: parameters, states, times; None if not all are known."""
    initial = mapping(scope.problem.get("initial_state"))
    bounds = {"t": scope.problem.get("initial_time", 0)}
    bounds |= {state: initial.get(state, initial.get("*")) for state in scope.states}
    values = {name: _number(scope, bound) for name, bound in bounds.items()}
    known = {name: value for name, value in values.items() if value is not None}
    if len(known) < len(values):
        return None
    time = known.pop("t")
    ends = {f"{name}_{end}": value for name, value in known.items() for end in ("0", "f")}
    return {**scope.parameters, **ends, "t0": time, "tf": time}


def _check_segments(scope: Scope, method: dict[str, Any], flaws: Flaws) -> None:
    segments = mapping(method.get("segments"))
    by = segments.get("by")
    if not isinstance(by, str):
        return
    wanted, other = ("length", "count") if by == "time" else ("count", "length")
    place = "method", "segments"
    if segments.get(wanted) is None:
        flaws.add(f"segments by {quoted(by)} need {wanted!r}", *place)
    if segments.get(other) is not None:
        flaws.add(f"segments by {quoted(by)} have no {other!r}", *place, other)
    if by == "time":
        end = interval_of(scope, scope.problem.get("final_time")) or FREE
        start = interval_of(scope, scope.problem.get("initial_time", 0)) or FREE
        if method.get("lookahead") == "end" and end[0] != end[1]:
            detail = (
                "segments by time look ahead to the end only where the final time is fixed; give a number"
            )
            flaws.add(detail, "method", "lookahead")
        length = _number(scope, segments.get("length"))
        if not np.isfinite(end[1]):
            flaws.add("segments by time need a latest final time", "problem", "final_time")
        elif length is not None and length > 0 and end[1] - start[0] > MOST_SEGMENTS * length:
            detail = f"limit: at most {MOST_SEGMENTS:,} segments until the latest final time"
            flaws.add(detail, *place, "length", type="limit")
    elif by not in scope.states:
        flaws.add(
            f"{quoted(by)} is neither 'time' nor a state{scope.suggest(by, scope.states)}", *place, "by"
        )
    else:
        ends = [
            interval_of(scope, mapping(scope.problem.get(key)).get(by))
            for key in ("initial_state", "final_state")
        ]
        if not all(_fixed(end) for end in ends) or ends[0] == ends[1]:
            detail = f"{quoted(by)} must go from a fixed initial to another fixed final value"
            flaws.add(detail, *place, "by")


def _number(scope: Scope, value: Any) -> float | None:
    interval = interval_of(scope, value)
    return interval[0] if _fixed(interval) and interval is not None else None


def _fixed(interval: Interval | None) -> bool:
    """Tell whether a bound is one value, or cannot be judged and is reported elsewhere."""
    return interval is None or interval[0] == interval[1]
