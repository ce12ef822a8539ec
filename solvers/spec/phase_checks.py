"""Mistakes between phases: names, states that come from nowhere, what is not done with phases yet."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from solvers.errors import ExpressionError
from solvers.expressions import parse, quoted
from solvers.spec.checks import check_bound
from solvers.spec.faults import Flaws, Path
from solvers.spec.phase_merge import PhaseView, listed, phase_fields, phase_views
from solvers.spec.phases import MAX_PHASES, phase_scope
from solvers.spec.scope import Scope, mapping, read_model
from solvers.spec.values import Interval

_METHODS = ("auto", "swcm", "gpm", "hermite_simpson")


def phase_documents(scope: Scope) -> Iterator[tuple[PhaseView, dict[str, Any]]]:
    """Yield each phase with the document that asks for it alone."""
    views, whole = phase_views(scope.problem)[:MAX_PHASES], scope.document
    if _method(whole) not in _METHODS:  # reported where it stands
        whole = {key: value for key, value in whole.items() if key != "method"}
    for view, fields in zip(views, phase_fields(views, _interval), strict=True):
        problem = {key: value for key, value in fields.items() if value is not None}
        yield view, {**whole, "problem": problem}


def check_phases(scope: Scope, flaws: Flaws) -> None:
    """Names given twice, links without phases or twice, states without a begin, what is not supported."""
    views = phase_views(scope.problem)
    links = [mapping(item) for item in listed(scope.problem.get("links"))]
    if not views:
        if links:
            flaws.add("links join phases, and there are none", "problem", "links")
        return
    _check_twice([view.phase.get("name") for view in views], "phase", ("problem", "phases"), ("name",), flaws)
    _check_twice(
        [link.get("to") for link in links], "link to this phase", ("problem", "links"), ("to",), flaws
    )
    if len(views) <= MAX_PHASES:
        _check_begins(scope, views, links, flaws)
        _check_common(scope, views, flaws)
    for place, what in _not_done(scope.document):
        flaws.add(f"unsupported: {what} with phases is not in this version", *place, type="unsupported")


def _check_twice(names: Sequence[object], what: str, place: Path, key: Path, flaws: Flaws) -> None:
    for index, name in enumerate(names):
        if isinstance(name, str) and name in names[:index]:
            flaws.add(f"there is a {what} already: {quoted(name)}", *place, index, *key)


def _check_begins(
    scope: Scope, views: Sequence[PhaseView], links: Sequence[Mapping[str, Any]], flaws: Flaws
) -> None:
    """Every state of a later phase comes from the phase before, a jump, or its own initial state."""
    jumps = {_text(link.get("to")): mapping(link.get("jump")) for link in links}
    before: Collection[str] | None = None
    for view in views:
        own = phase_scope(scope, view)
        states = (*own.states, *own.rated)
        initial = mapping(view.phase.get("initial_state")).keys() | mapping(view.phase.get("initial_control"))
        known = {*initial, *jumps.get(_text(view.phase.get("name")), ())}
        if view.index and before is not None and own.known and "*" not in known:
            for name in states:
                if name not in before and name not in known:
                    detail = (
                        f"the phase before has no state {quoted(name)}: say where it begins, "
                        "in initial_state or in the jump of a link (null where it is free)"
                    )
                    flaws.add(detail, "problem", "phases", view.index)
        before = states if own.known else None


def _check_common(scope: Scope, views: Sequence[PhaseView], flaws: Flaws) -> None:
    """What stands beside phases must be of use to them."""
    first, last = views[0], views[-1]
    for key, view, which in (
        ("initial_state", first, "first"),
        ("initial_control", first, "first"),
        ("final_state", last, "last"),
        ("final_control", last, "last"),
        ("final_attitude", last, "last"),
    ):
        if view.has_own_model and scope.problem.get(key):
            detail = f"the {which} phase has a model of its own: what is said here belongs there"
            flaws.add(detail, "problem", key)
    if all(view.has_own_model for view in views) and mapping(scope.problem.get("objective")).get("maximum"):
        detail = "every phase has a model of its own: its peak is said in its own objective"
        flaws.add(detail, "problem", "objective", "maximum")
    for place, expression in _over_the_flight(scope.problem):
        try:
            names = parse(expression).names
        except (ExpressionError, TypeError):
            continue  # reported where it stands
        for view, which, ends in ((first, "first", ("_0",)), (last, "last", ("_f",))):
            own = phase_scope(scope, view)
            known = {name + end for name in own.states + own.controls for end in ends}
            known |= {f"{name}_f" for name in own.output_names} if which == "last" else set()
            wanted = {name for name in names & scope.boundary_names if name.endswith(ends)}
            wanted -= scope.parameter_names | scope.integral_names
            for name in sorted(wanted - known) if own.known else ():
                flaws.add(f"the {which} phase knows no {quoted(name)}", "problem", *place)


def _over_the_flight(problem: Mapping[str, Any]) -> Iterator[tuple[Path, Any]]:
    yield ("objective", "terminal"), mapping(problem.get("objective")).get("terminal", 0)
    for index, item in enumerate(listed(problem.get("boundary_constraints"))):
        yield ("boundary_constraints", index, "expression"), mapping(item).get("expression", 0)


def _not_done(document: Mapping[str, Any]) -> Iterator[tuple[Path, str]]:
    """Yield what a flight of phases cannot work with yet: place in the document, and what it is."""
    method = _method(document)
    if method is not None and method not in _METHODS:
        yield ("method", "name"), f"the method {method}"


def _method(document: Mapping[str, Any]) -> str | None:
    return _text(mapping(document.get("method")).get("name", "auto"))


def _text(value: object) -> str | None:
    """A name, None for what is none: that is reported where it stands."""
    return value if isinstance(value, str) else None


def _interval(bound: Any, model: Any) -> Interval | None:
    scope = Scope({}, {}, mapping(model))
    read_model(scope)
    return check_bound(bound, scope, Flaws())
