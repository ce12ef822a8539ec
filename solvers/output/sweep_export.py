"""A whole sweep in columns: one row, or one leading index of an array, for each of its points.

The columns are ``index``, one for each pointer, ``job``, ``status``, ``success`` and the figures of
`FIGURES`. Numbers that a point does not have are NaN in arrays and empty in CSV.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

FIGURES = (
    "objective",
    "final_time",
    "terminal_error",
    "max_state_error",
    "max_bound_violation",
    "max_path_violation",
    "iterations",
    "seconds",
)

Row = Mapping[str, Any]
"""A point: ``values``, ``job``, ``status``, ``success`` and those of `FIGURES` that it has."""


def sweep_csv(pointers: Sequence[str], rows: Sequence[Row]) -> str:
    """Return the table as CSV; text that a spreadsheet would take for a formula begins with an apostrophe."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["index", *pointers, "job", "status", "success", *FIGURES])
    for index, row in enumerate(rows):
        figures = [row.get(name) for name in FIGURES]
        values = [_cell(value) for value in row["values"]]
        writer.writerow([index, *values, row["job"], row["status"], row.get("success"), *figures])
    return text.getvalue()


def sweep_npz(
    pointers: Sequence[str], rows: Sequence[Row], histories: Mapping[str, NDArray[np.float64]]
) -> bytes:
    """Return the table as arrays by name, with ``histories`` (a row a point); loads without pickle."""
    arrays: dict[str, Any] = {name: _numbers([row.get(name) for row in rows]) for name in FIGURES}
    for number, pointer in enumerate(pointers):
        arrays[pointer.lstrip("/").replace("/", ".")] = _column([row["values"][number] for row in rows])
    arrays |= {
        "index": np.arange(len(rows)),
        "pointers": np.array(pointers),
        "job": np.array([row["job"] for row in rows]),
        "status": np.array([row["status"] for row in rows]),
        "success": np.array([bool(row.get("success")) for row in rows]),
        **histories,
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def stacked(
    histories: Sequence[Mapping[str, Sequence[float | None]] | None],
) -> dict[str, NDArray[np.float64]]:
    """Stack the histories of all points by name, (points, longest); NaN where one has nothing."""
    names = dict.fromkeys(name for history in histories if history is not None for name in history)
    longest = max(
        (len(values) for history in histories if history is not None for values in history.values()),
        default=0,
    )
    arrays = {name: np.full((len(histories), longest), np.nan) for name in names}
    for number, history in enumerate(histories):
        for name, values in (history or {}).items():
            arrays[name][number, : len(values)] = _numbers(values)
    return arrays


def _numbers(values: Sequence[Any]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], np.float64)


def _column(values: Sequence[Any]) -> NDArray[Any]:
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, np.float64)
    return np.array([_text(value) for value in values])


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _cell(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    text = _text(value)
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text
