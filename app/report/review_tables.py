"""What a design review asks for as tables: checks, margins, sensitivities, frequencies, provenance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from app.report.cells import Result, Table, cut, figure, symbol, verdict

_MARGIN_HEAD = ("name", "in the document", "smallest", "largest", "bounds", "margin", "at", "active")


def verification_tables(result: Result) -> Iterator[Table]:
    """Every check with its value and its limit; what each state missed."""
    verification = result["verification"]
    rows = [
        (
            item["name"].replace("_", " "),
            figure(item["value"], 3),
            figure(item["limit"], 3),
            verdict(item["passed"]),
        )
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


def review_tables(result: Result) -> Iterator[Table]:
    """Margins, sensitivities, frequencies, convergence."""
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
            item.get("name", ""),  # results of before have none
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
        yield cut(Table("Margins", _MARGIN_HEAD, margins, "A negative margin is a violation."))
    sensitivity = {key: value for key, value in (result["sensitivity"] or {}).items() if value}
    if sensitivity:
        ordered = sorted(sensitivity.items(), key=lambda item: -abs(item[1]))
        numbers = [(pointer, figure(value)) for pointer, value in ordered]
        columns = ("number", "d objective / d number")
        yield cut(Table("Sensitivity of the objective, largest first", columns, numbers))
    if result["model_report"]:
        yield _frequencies(result["model_report"])
    if result["convergence"]:
        keys = ("level", "nodes", "objective", "max_state_error")
        levels = [[figure(item[key], 10) for key in keys] for item in result["convergence"]]
        yield cut(Table("Convergence", ("level", "nodes", "objective", "largest state error"), levels))


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
