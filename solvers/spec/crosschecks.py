"""Mistakes that no field can see alone: clashing names, ends against bounds, times, a singular mass matrix.

All of them work on the scope, so they are judged even where other fields of the document are wrong; what
cannot be judged is passed over, for the fields themselves report why.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from solvers.errors import pointer
from solvers.expressions import RESERVED, quoted
from solvers.models import LIBRARY
from solvers.spec.attitude import check_attitude
from solvers.spec.checks import check_constant, interval_of
from solvers.spec.data import check_data
from solvers.spec.faults import Flaws, Path
from solvers.spec.mass_check import check_mass
from solvers.spec.modal_checks import check_modal
from solvers.spec.phase_checks import check_phases, phase_documents
from solvers.spec.piecewise_checks import check_piecewise
from solvers.spec.scenarios import MAX_CASES, check_cases
from solvers.spec.scope import (
    MAX_NAME,
    MAX_STATES,
    VIBRATION_ENERGY,
    Scope,
    has_elastic_coordinates,
    mapping,
    read_scope,
)
from solvers.spec.support import check_support

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*", re.ASCII)


def cross_check(scope: Scope) -> Flaws:
    """Return every mistake between the parts of the document, with paths from its root."""
    flaws = Flaws()
    _check_names(scope, flaws)
    _check_library(scope, flaws)
    check_piecewise(scope, flaws)
    _check_times(scope, flaws)
    if not scope.problem.get("phases"):
        _check_ends(scope, flaws)
        _check_control_ends(scope, flaws)
        check_attitude(scope, flaws)
    _check_design(scope, flaws)
    check_data(scope, flaws)
    _check_guess(scope, flaws)
    check_support(scope, flaws)
    check_cases(scope, flaws)
    check_phases(scope, flaws)
    _check_each_phase(scope, flaws)
    if scope.known and scope.axes:
        check_modal(scope, flaws)
    elif scope.known and scope.coordinates:
        check_mass(scope, flaws)
    _check_each_case(scope, flaws)
    return flaws


def _check_each_case(scope: Scope, flaws: Flaws) -> None:
    """What would be wrong with the document if a case were all of it, and is not wrong without the case."""
    problem = scope.problem
    cases = mapping(problem.get("scenarios")).get("cases")
    if not isinstance(cases, list) or not scope.known:
        return
    without = {path for path, _, _ in flaws.found}
    for index, case in enumerate(map(mapping, cases[:MAX_CASES])):
        model = mapping(problem.get("model"))
        parameters = {**mapping(model.get("parameters")), **mapping(case.get("parameters"))}
        alone = {key: value for key, value in problem.items() if key != "scenarios"}
        alone["model"] = {**model, "parameters": parameters}
        for key in ("initial_state", "final_state", "bounds"):
            alone[key] = {**mapping(problem.get(key)), **mapping(case.get(key))}
        here = ("problem", "scenarios", "cases", index)
        for path, detail, kind in cross_check(read_scope({**scope.document, "problem": alone})).found:
            own = _said_in(case, path)
            if own:
                flaws.add(detail, *here, *own, type=kind)
            elif path not in without:
                flaws.add(f"in this case {pointer(path)}: {detail}", *here, *_to_blame(case, path), type=kind)


def _said_in(case: dict[str, Any], path: Path) -> Path:
    """Where a case itself says what is at ``path`` of the document that it makes; nothing if it does not."""
    key, rest = ("parameters", path[3:]) if path[1:3] == ("model", "parameters") else (path[1], path[2:])
    return (key, *rest) if rest and rest[0] in mapping(case.get(str(key))) else ()


def _to_blame(case: dict[str, Any], path: Path) -> Path:
    """What of a case makes wrong what is right at ``path`` of the document; nothing if that is not clear."""
    if path[1:2] == ("model",):
        return ("parameters",)
    return ("bounds", path[2]) if path[2:] and path[2] in mapping(case.get("bounds")) else ()


def _check_each_phase(scope: Scope, flaws: Flaws) -> None:
    """What would be wrong with the document that asks for a phase alone, where it stands in this one."""
    for view, document in phase_documents(scope) if scope.known else ():
        for path, detail, kind in cross_check(read_scope(document)).found:
            flaws.add(detail, *view.located(path), type=kind)


def _check_names(scope: Scope, flaws: Flaws) -> None:
    """Every name well formed, none reserved, none twice, none like a name that the product generates."""
    of_library = mapping(scope.problem.get("model")).get("kind") == "library"
    generated, seen = _generated(scope), dict[str, str]()
    for name, what, place in _declared(scope):
        # The names of a library model are nobody's fault.
        detail = None if of_library and place[1] == "model" else _name_flaw(name, seen, generated)
        if detail:
            flaws.add(detail, *place)
        seen.setdefault(name, what)


def _check_library(scope: Scope, flaws: Flaws) -> None:
    name = mapping(scope.problem.get("model")).get("name")
    entry = LIBRARY.get(name) if isinstance(name, str) else None
    for parameter in scope.positive:
        value = scope.parameters.get(parameter)
        if value is not None and not value > 0.0:
            detail = (
                f"the modes take more inertia than there is: {parameter} = {value:g}, "
                "but D = J less the couplings of the modes must be positive definite"
            )
            flaws.add(detail, "problem", "model", "parameters")
            break
    if entry is not None and entry.plant_only:
        seen_as = ", ".join(f"'{simple}'" for simple in entry.views)
        detail = (
            f"{quoted(entry.name)} can be flown, not optimised: "
            f"take it as method.plant of a problem with {seen_as}"
        )
        flaws.add(detail, "problem", "model", "name")


def _declared(scope: Scope) -> Iterator[tuple[str, str, Path]]:
    """Yield every name that the document gives to something, what it is, and where it stands."""
    model = scope.model
    where = {"mechanical": ("coordinates", "coordinate"), "modal": ("axes", "axis")}
    for key, what in (where.get(str(model.get("kind")), ("states", "state")), ("controls", "control")):
        names = model.get(key)
        for index, name in enumerate(names[:MAX_STATES] if isinstance(names, list) else ()):
            if isinstance(name, str):
                yield name, what, ("problem", "model", key, index)
    modes = model.get("modes")
    for index, item in enumerate(modes[:MAX_STATES] if isinstance(modes, list) else ()):
        name = mapping(item).get("name")
        if isinstance(name, str):
            yield name, "mode", ("problem", "model", "modes", index, "name")
    for key in ("parameters", "definitions"):
        for name in mapping(model.get(key)):
            yield name, key[:-1], ("problem", "model", key, name)
    for name in mapping(scope.problem.get("data")):
        yield name, "data table", ("problem", "data", name)
    for key in ("outputs", "integrals"):
        items = scope.problem.get(key)
        for index, item in enumerate(items if isinstance(items, list) else ()):
            name = mapping(item).get("name")
            if isinstance(name, str):
                yield name, key[:-1], ("problem", key, index, "name")


def _name_flaw(name: str, seen: dict[str, str], generated: dict[str, str]) -> str | None:
    if len(name) > MAX_NAME:
        return f"limit: a name has at most {MAX_NAME} characters"
    if not _NAME.fullmatch(name):
        return f"{quoted(name)} is not a name: a letter, then letters, digits and _"
    if name in RESERVED:
        return f"the name {quoted(name)} is reserved"
    if name in seen:
        article = "an" if seen[name][0] in "aeiou" else "a"
        return f"the name {quoted(name)} is already taken by {article} {seen[name]}"
    if name in generated:
        return f"the name {quoted(name)} is reserved: it is generated for {quoted(generated[name])}"
    return None


def _generated(scope: Scope) -> dict[str, str]:
    """Return every name that the product makes -> the name from which it makes it."""
    made = {f"{q}{end}": q for q in scope.coordinates for end in ("_dot", "_ddot")}
    made |= {f"{u}_dot": u for u in scope.controls}
    if has_elastic_coordinates(scope):
        made[VIBRATION_ENERGY] = "modes" if scope.axes else "flexible"
    made |= {f"{output}_f": output for output in scope.output_names}
    return made | {f"{x}{end}": x for x in scope.states + scope.controls for end in ("_0", "_f")}


def _check_times(scope: Scope, flaws: Flaws) -> None:
    start = interval_of(scope, scope.problem.get("initial_time", 0))
    end = interval_of(scope, scope.problem.get("final_time"))
    if start is None or end is None:
        return
    if end[1] <= start[0]:
        detail = f"the final time (at most {end[1]:g}) is not after the initial time (at least {start[0]:g})"
        flaws.add(detail, "problem", "final_time")
    guess = mapping(scope.problem.get("guess")).get("final_time")
    value = None if guess is None else check_constant(guess, scope, Flaws())
    if value is not None and value <= start[0]:
        detail = f"the guess {value:g} is not after the initial time (at least {start[0]:g})"
        flaws.add(detail, "problem", "guess", "final_time")


def _check_ends(scope: Scope, flaws: Flaws) -> None:
    bounds = mapping(scope.problem.get("bounds"))
    for key in ("initial_state", "final_state"):
        ends = scope.problem.get(key)
        if not isinstance(ends, dict):
            continue
        for state in scope.states:
            if state not in ends and "*" not in ends:
                if key == "initial_state":
                    detail = (
                        f"the state {quoted(state)} is missing; give it a value, or null where it is free"
                    )
                    flaws.add(detail, "problem", key)
                continue
            place = state if state in ends else "*"
            end, allowed = interval_of(scope, ends[place]), interval_of(scope, bounds.get(state))
            if end is not None and allowed is not None and (end[1] < allowed[0] or end[0] > allowed[1]):
                inside_what = f"[{allowed[0]:g}, {allowed[1]:g}]"
                detail = f"the state {quoted(state)} ends outside its bounds {inside_what}"
                flaws.add(detail, "problem", key, place)


def _check_control_ends(scope: Scope, flaws: Flaws) -> None:
    bounds = mapping(scope.problem.get("bounds"))
    for key in ("initial_control", "final_control"):
        ends = mapping(scope.problem.get(key))
        for control in scope.controls:
            end, allowed = interval_of(scope, ends.get(control)), interval_of(scope, bounds.get(control))
            if end is not None and allowed is not None and (end[1] < allowed[0] or end[0] > allowed[1]):
                inside_what = f"[{allowed[0]:g}, {allowed[1]:g}]"
                detail = f"the control {quoted(control)} is outside its bounds {inside_what} there"
                flaws.add(detail, "problem", key, control)


def _check_design(scope: Scope, flaws: Flaws) -> None:
    """What is optimised must be a parameter of the model, its guess inside its bounds."""
    for name, item in mapping(scope.problem.get("design")).items():
        if scope.known and name not in scope.parameter_names:
            detail = f"the model has no parameter {quoted(name)}{scope.suggest(name, scope.parameter_names)}"
            flaws.add(detail, "problem", "design", name)
        elif scope.computed_names:
            # What is computed has the numbers of its parameters built in: it would not follow the design.
            detail = (
                "unsupported: design parameters of a model with computed quantities are not in this version"
            )
            flaws.add(detail, "problem", "design", name, type="unsupported")
        bound, guess = interval_of(scope, mapping(item).get("bounds")), mapping(item).get("guess")
        value = None if guess is None else check_constant(guess, scope, Flaws())
        if bound is not None and value is not None and not bound[0] <= value <= bound[1]:
            detail = f"the guess {value:g} is outside the bounds [{bound[0]:g}, {bound[1]:g}]"
            flaws.add(detail, "problem", "design", name, "guess")


def _check_guess(scope: Scope, flaws: Flaws) -> None:
    """Lists that share the guess's own ``times`` must be as long as it is."""
    guess = mapping(scope.problem.get("guess"))
    times = guess.get("times")
    if not isinstance(times, list):
        return
    for key in ("states", "controls"):
        for name, values in mapping(guess.get(key)).items():
            if isinstance(values, list) and len(values) != len(times):
                detail = f"{len(times)} times for {len(values)} values"
                flaws.add(detail, "problem", "guess", key, name)
