"""The numbers of a result as tables of a report. Cells are text, or MathML that is marked as such."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from app.report.equations import bound_text
from app.report.mathml import inline, name
from solvers.models import LIBRARY
from solvers.plot import with_unit
from solvers.spec import BoundValue, LibraryReference, ProblemSpec, ScenarioSpec

Result = Mapping[str, Any]

# Longer tables are for files, not for paper.
MOST_ROWS = 60


@dataclass(frozen=True)
class Table:
    """A table with its caption; ``note`` stands below it."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


def figure(value: Any, digits: int = 6) -> str:
    """A number for people; what is not known is a dash."""
    if value is None:
        return "–"  # noqa: RUF001 - a dash, as it stands in printed tables
    return f"{value:.{digits}g}" if isinstance(value, int | float) else str(value)


def symbol(text: str) -> Markup:
    """A name as MathML."""
    return inline(name(text))


def problem_tables(problem: ProblemSpec, units: Mapping[str, str]) -> Iterator[Table]:
    """States and controls with their ends and bounds; parameters. Columns that tell nothing are left out."""
    for table in _problem_tables(problem, units):
        told = [
            column
            for column in range(len(table.head))
            if column == 0 or {row[column] for row in table.rows} - {"", "free"}
        ]
        rows = [[row[column] for column in told] for row in table.rows]
        yield _cut(Table(table.caption, [table.head[column] for column in told], rows))


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


def answer_tables(result: Result, units: Mapping[str, str]) -> Iterator[Table]:
    """What was found: outputs, integrals, design, switching, the other plants, the command, segments."""
    rows: Sequence[Sequence[str]]
    if len(result["phases"]) > 1:
        rows = [
            (phase["name"], figure(phase["t0"], 10), figure(phase["tf"], 10)) for phase in result["phases"]
        ]
        yield Table("Phases", ("phase", "from", "to"), rows)
    if result.get("design"):
        rows = [(symbol(key), figure(value, 10)) for key, value in result["design"].items()]
        yield Table("Design parameters", ("parameter", "value"), rows)
    if result.get("integrals"):
        rows = [(symbol(key), figure(value, 10)) for key, value in result["integrals"].items()]
        yield Table("Integrals", ("integral", "value"), rows)
    if result.get("outputs"):
        cells = [
            (
                symbol(item["name"]),
                item["units"],
                *(figure(item[key]) for key in ("min", "min_at", "max", "max_at")),
            )
            for item in result["outputs"]
        ]
        yield Table("Extremes of the outputs", ("output", "unit", "smallest", "at", "largest", "at"), cells)
    for control, found in result.get("switching", {}).items():
        arcs = _arcs(found, result["phases"])
        yield Table(
            f"Arcs of the control {control}",
            ("arc", "from", "to", "at", with_unit("level", {"level": units.get(control, "")})),
            arcs,
        )
    yield from _flown_tables(result)


def _flown_tables(result: Result) -> Iterator[Table]:
    """The other plants, the command, the coasting, the segments of a mission."""
    if result.get("scenarios"):
        rows = [
            (plant, _verdict(own["verification"]["passed"]), *_maxima(own["verification"]))
            for plant, own in result["scenarios"].items()
        ]
        yield Table("Plants under this command", ("plant", "verdict", *_MAXIMA.values()), rows)
    if result.get("command"):
        command = result["command"]
        errors = command["verification"]["states"].items()
        rows_of = f"{len(command['t'])} rows of {figure(command['period'])}, rule {command['rule']}"
        yield Table(
            f"Command: {rows_of}, flown as it is",
            ("state", "at the end", "miss"),
            [(symbol(state), figure(own["final"], 10), figure(own["error"], 3)) for state, own in errors],
            command["verification"].get("note", ""),
        )
    if result.get("coast"):
        coast = result["coast"]
        yield Table(
            f"Coasting for {figure(coast['seconds'])} at zero control: what is left",
            ("quantity", "smallest", "largest", "amplitude"),
            [
                (symbol(key), *(figure(own[part], 4) for part in ("min", "max", "amplitude")))
                for key, own in coast["residual"].items()
            ],
            coast.get("note", ""),
        )
    if result.get("segments"):
        rows = [
            (
                str(segment["index"]),
                figure(segment["t0"]),
                figure(segment["tf"]),
                segment["prediction"]["status"],
                figure(segment["prediction"]["seconds"], 3),
                figure(segment["tracking_seconds"], 3),
                figure(segment["wait_seconds"], 3),
            )
            for segment in result["segments"]
        ]
        head = ("segment", "from", "to", "prediction", "predicted in, s", "tracked in, s", "waited, s")
        yield _cut(Table("Segments", head, rows))


def verification_tables(result: Result) -> Iterator[Table]:
    """Every check with its value and its limit; what each state missed."""
    verification = result["verification"]
    rows = [
        (_words(item["name"]), figure(item["value"], 3), figure(item["limit"], 3), _verdict(item["passed"]))
        for item in verification["checks"]
    ]
    yield Table(
        "Checks", ("check", "value", "limit", "verdict"), rows, "Relative to the scale of each quantity."
    )
    states = [
        (symbol(state), *(figure(own[key], 3) for key in ("terminal_error", "max_error", "at", "tolerance")))
        for state, own in verification["states"].items()
    ]
    head = ("state", "miss at the end", "largest error", "at", "tolerance")
    yield Table("States, in their own units", head, states)


def review_tables(result: Result, names: Mapping[str, str]) -> Iterator[Table]:
    """Margins, sensitivities, frequencies, convergence; ``names``: what pointers stand for."""
    if result.get("diagnosis"):
        limits = [
            (item["name"], item["pointer"], figure(item["violation"], 4), figure(item["at"]))
            for item in result["diagnosis"]
        ]
        yield Table(
            "What stands in the way, by an elastic re-solve",
            ("name", "in the document", "violation", "at"),
            limits,
        )
    margins = [
        (
            names.get(item["pointer"], ""),
            item["pointer"],
            figure(item["min"]),
            figure(item["max"]),
            " … ".join(figure(bound) for bound in item["bounds"]),
            figure(item["margin"], 3),
            figure(item["at"]),
            ", ".join(f"{figure(start, 5)} … {figure(stop, 5)}" for start, stop in item["active"][:6])
            or "never",
        )
        for item in result["constraints"]
    ]
    if margins:
        yield _cut(Table("Margins", _MARGIN_HEAD, margins, "A negative margin is a violation."))
    sensitivity = {key: value for key, value in (result["sensitivity"] or {}).items() if value}
    if sensitivity:
        ordered = sorted(sensitivity.items(), key=lambda item: -abs(item[1]))
        numbers = [(pointer, figure(value)) for pointer, value in ordered]
        columns = ("number", "d objective / d number")
        yield _cut(Table("Sensitivity of the objective, largest first", columns, numbers))
    if result["model_report"]:
        yield _frequencies(result["model_report"])
    if result["convergence"]:
        keys = ("level", "nodes", "objective", "max_state_error")
        levels = [[figure(item[key], 10) for key in keys] for item in result["convergence"]]
        yield _cut(Table("Convergence", ("level", "nodes", "objective", "largest state error"), levels))


def provenance_table(result: Result) -> Table:
    """What the answer was made with."""
    provenance, statistics = result["provenance"], result["statistics"]
    versions = ", ".join(f"{name} {version}" for name, version in provenance["versions"].items())
    seconds = [
        f"{stage} {figure(value, 3)}" for stage, value in statistics["seconds"].items() if value is not None
    ]
    rows = [
        ("versions", versions),
        ("platform", provenance["platform"]),
        ("linear solver", figure(provenance["linear_solver"])),
        ("seed", figure(provenance["seed"])),
        ("program", f"{statistics['variables']} variables, {statistics['constraints']} constraints"),
        (
            "solver",
            f"{statistics['nlp_solver']}: {statistics['nlp_status']}, {statistics['iterations']} iterations",
        ),
        ("seconds", ", ".join(seconds)),
        ("verified by", f"{result['verification']['integrator']}, rtol {result['verification']['rtol']:g}"),
        ("SHA-256 of the document with its defaults", result["resolved"]["sha256"]),
        ("defaults applied", ", ".join(result["resolved"]["defaults_applied"]) or "none"),
    ]
    return Table("Provenance", ("", ""), rows)


_MARGIN_HEAD = ("name", "in the document", "smallest", "largest", "bounds", "margin", "at", "active")
_MAXIMA = {
    "terminal_error": "miss at the end",
    "max_state_error": "largest state error",
    "max_bound_violation": "bounds",
    "max_path_violation": "path",
}


def _maxima(verification: Mapping[str, Any]) -> list[str]:
    return [figure(verification[key], 3) for key in _MAXIMA]


def _verdict(passed: bool | None) -> str:
    return "passed" if passed else "FAILED"


def _words(text: str) -> str:
    return text.replace("_", " ")


def _cut(table: Table) -> Table:
    """The first rows of a long table, and how many there are."""
    left = len(table.rows) - MOST_ROWS
    if left <= 0:
        return table
    note = f"{table.note} {left} more rows are in the result.".strip()
    return Table(table.caption, table.head, table.rows[:MOST_ROWS], note)


def _end(ends: Mapping[str, Any], state: str) -> Any:
    return ends.get(state, ends.get("*"))


def _arcs(found: Mapping[str, Any], phases: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    times = [phases[0]["t0"], *found["times"], phases[-1]["tf"]]
    return [
        (str(index + 1), figure(times[index], 10), figure(times[index + 1], 10), kind, figure(level))
        for index, (kind, level) in enumerate(zip(found["arcs"], found["levels"], strict=True))
    ]


def _frequencies(report: Mapping[str, Any]) -> Table:
    ends = [(end, report[end]) for end in ("initial", "final") if report.get(end)]
    rows = [
        (
            end,
            ", ".join(figure(value) for value in own["natural_frequencies_hz"]),
            ", ".join(figure(value, 3) for value in own["damping_ratios"]),
            figure(own["smallest_mass_eigenvalue"]),
        )
        for end, own in ends
    ]
    head = ("end", "natural frequencies, Hz", "damping ratios", "smallest eigenvalue of M")
    return Table("The model at both ends", head, rows)


def _parameters(problem: ProblemSpec) -> Iterator[Table]:
    model = problem.submitted_model
    known = LIBRARY[model.name].parameters if isinstance(model, LibraryReference) else {}
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
