"""The problem as tables: states, controls, times, parameters, data, plants."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from markupsafe import Markup

from app.report.cells import Table, cut, figure, symbol
from app.report.equations import bound_text
from solvers.spec import BoundValue, LibraryReference, ProblemSpec, ScenarioSpec


def problem_tables(problem: ProblemSpec, units: Mapping[str, str]) -> Iterator[Table]:
    """States and controls with their ends and bounds; parameters. Columns that tell nothing are left out."""
    for table in _problem_tables(problem, units):
        told = [
            column
            for column in range(len(table.head))
            if column == 0 or {row[column] for row in table.rows} - {"", "free"}
        ]
        rows = [[row[column] for column in told] for row in table.rows]
        yield cut(Table(table.caption, [table.head[column] for column in told], rows))


def _problem_tables(problem: ProblemSpec, units: Mapping[str, str]) -> Iterator[Table]:
    states = [
        (
            symbol(state),
            units.get(state, ""),
            bound_text(_end(problem.initial_state, state)),
            bound_text(_end(problem.final_state, state)),
            bound_text(problem.bounds.get(state)),
        )
        for state in problem.model.states
    ]
    yield Table("States", ("state", "unit", "at the start", "at the end", "in between"), states)
    if problem.model.controls:
        controls = [
            (
                symbol(control),
                units.get(control, ""),
                bound_text(problem.bounds.get(control)),
                bound_text(problem.control_rates.get(control)),
                bound_text(problem.initial_control.get(control)),
                bound_text(problem.final_control.get(control)),
            )
            for control in problem.model.controls
        ]
        yield Table(
            "Controls", ("control", "unit", "bounds", "its rate", "at the start", "at the end"), controls
        )
    times = [
        ("initial time", bound_text(problem.initial_time)),
        ("final time", bound_text(problem.final_time)),
    ]
    yield Table("Time", ("", "value or interval"), times)
    yield from _parameters(problem)
    if problem.data:
        given = [
            (
                symbol(key),
                str(len(item.x)),
                *map(bound_text, (item.x[0], item.x[-1])),
                item.interpolation,
                item.outside,
            )
            for key, item in problem.data.items()
        ]
        yield Table("Data tables", ("table", "points", "from", "to", "interpolation", "outside"), given)
    if problem.scenarios is not None:
        rows = [(case.name, _differences(case)) for case in problem.scenarios.cases]
        choice = f"objective: {problem.scenarios.choice}"
        yield Table(f"Plants under one command, {choice}", ("plant", "what differs"), rows)


def _parameters(problem: ProblemSpec) -> Iterator[Table]:
    model = problem.submitted_model
    known = model.entry.parameters if isinstance(model, LibraryReference) else {}
    values = problem.model.parameter_values()
    if not values:
        return
    rows = [
        (
            symbol(key),
            figure(value, 10),
            known[key].unit if key in known else problem.units.get(key, ""),
            known[key].description if key in known else "",
        )
        for key, value in values.items()
    ]
    yield Table("Parameters", ("parameter", "value", "unit", "meaning"), rows)


def _differences(case: ScenarioSpec) -> Markup:
    parts: list[tuple[str, Mapping[str, BoundValue]]] = [
        ("", case.parameters),
        (" at the start", case.initial_state),
        (" at the end", case.final_state),
        (" in between", case.bounds),
    ]
    return Markup(", ").join(
        Markup("{} = {}{}").format(symbol(key), bound_text(value), where)
        for where, values in parts
        for key, value in values.items()
    )


def _end(ends: Mapping[str, Any], state: str) -> Any:
    return ends.get(state, ends.get("*"))
