"""A result as a table for people."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table


def result_table(result: Mapping[str, Any], reference: Mapping[str, Any] | None = None) -> Table:
    """The result in figures, beside the ``reference`` of its case if there is one."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table("quantity", "value", box=box.SIMPLE_HEAD)
    table.columns[1].overflow = "fold"

    def row(quantity: str, value: str | float | None) -> None:
        if value is not None:
            table.add_row(escape(quantity), escape(value if isinstance(value, str) else f"{value:.10g}"))

    verdict = "solved and verified" if result["success"] else "not solved"
    row("outcome", f"{verdict} ({result['status']})")
    row(
        "method", ", ".join(f"{key} {value}" for key, value in result["method"].items()).removeprefix("name ")
    )
    row("objective", result["objective"])
    if reference and reference.get("objective") is not None and result["objective"] is not None:
        row("  reference", reference["objective"])
        row("  error", f"{result['objective'] - reference['objective']:+.2e}")
    row("final time", result["final_time"])
    for control, structure in (result.get("switching") or {}).items():
        row(f"switching times of {control}", _list(structure["times"]))
        expected = (reference or {}).get("switching")
        if expected is not None:
            row("  reference", _list(expected[control] if isinstance(expected, Mapping) else expected))
    _verification(row, result.get("verification") or {})
    statistics = result.get("statistics") or {}
    if statistics:
        row(
            "program",
            f"{statistics['variables']} variables, {statistics['constraints']} constraints, "
            f"{statistics['iterations']} iterations",
        )
        spent = {key: value for key, value in statistics["seconds"].items() if value is not None}
        row("seconds", ", ".join(f"{stage} {value:.2f}" for stage, value in spent.items()))
    return table


def _verification(row: Callable[[str, str], None], verification: Mapping[str, Any]) -> None:
    """Rows of the independent re-integration: what was found, and its limit."""
    if not verification:
        return
    row("verified by", f"{verification['integrator']}, rtol {verification['rtol']:g}")
    for check in verification.get("checks") or ():
        verdict = "passed" if check["passed"] else "FAILED"
        value = "-" if check["value"] is None else f"{check['value']:.2e}"
        row(f"  {str(check['name']).replace('_', ' ')}", f"{value} (limit {check['limit']:g}) {verdict}")


def _list(times: Any) -> str:
    return ", ".join(f"{time:.6f}" for time in times) or "none"
