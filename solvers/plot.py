"""A result as a picture: states and controls over time, bounds dashed, switches marked.

matplotlib is imported where a picture is drawn, and without pyplot: figures belong to nobody's global state.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"states": "#1f4e79", "controls": "#b03a2e", "outputs": "#2e7d4f"}
_ROW_HEIGHT = 1.7
_LONGEST_NAME = 80


def render(result: Mapping[str, Any], kind: Literal["svg", "png"], title: str = "") -> bytes:
    """The picture of a result as SVG or PNG."""
    import matplotlib

    # Not text but outlines: the picture looks the same wherever its fonts are not installed.
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": "ondelette"}):
        buffer = io.BytesIO()
        draw(result, title).savefig(
            buffer, format=kind, dpi=130, metadata={"Date": None} if kind == "svg" else None
        )
    return buffer.getvalue()


def draw(result: Mapping[str, Any], title: str = "") -> Figure:
    """The picture of a result as a matplotlib figure: a row for each state, control and output."""
    from matplotlib.figure import Figure

    trajectory = result["trajectory"]
    rows = [
        (name, values, colour)
        for group, colour in _COLOURS.items()
        for name, values in trajectory.get(group, {}).items()
        # A rated control is listed with the states too.
        if group != "states" or name not in trajectory["controls"]
    ]
    figure = Figure(figsize=(8.0, 0.9 + _ROW_HEIGHT * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    units = units_of(result)
    margins = {item["pointer"]: item for item in result["constraints"]}
    switches = sorted({time for found in result["switching"].values() for time in found["times"]})
    for axis, (name, values, colour) in zip(axes, rows, strict=True):
        # What is not finite (null in a result) leaves a gap.
        axis.plot(trajectory["t"], np.array(values, np.float64), color=colour, linewidth=1.6)
        _mark(axis, switches, _bounds(margins.get(f"/problem/bounds/{name}")))
        unit = units.get(name)
        axis.set_ylabel(_label(name if unit is None else f"{name} [{unit}]"), parse_math=False)
        axis.grid(visible=True, linewidth=0.4, alpha=0.5)
    axes[-1].set_xlabel(_label(f"t [{units['t']}]" if "t" in units else "t"), parse_math=False)
    figure.suptitle(_label(_headline(result, title)), parse_math=False, fontsize=11)
    return figure


def units_of(result: Mapping[str, Any]) -> dict[str, str]:
    """Name -> unit, as far as the document of a result tells them."""
    units: dict[str, str] = {
        item["name"]: item["units"] for item in result.get("outputs", []) if item["units"]
    }
    units.update(result["resolved"]["document"]["problem"].get("units", {}))
    return units


def _mark(axis: Axes, switches: list[float], bounds: list[float]) -> None:
    for time in switches:
        axis.axvline(time, color="#888888", linewidth=0.7, linestyle=":")
    for bound in bounds:
        axis.axhline(bound, color="#555555", linewidth=0.8, linestyle="--")


def _bounds(margin: Mapping[str, Any] | None) -> list[float]:
    """The bounds of a quantity that comes to rest on one of them; others would only squeeze the curve."""
    if margin is None or not margin["active"]:
        return []
    return [bound for bound in margin["bounds"] if bound is not None]


def _headline(result: Mapping[str, Any], title: str) -> str:
    name = title if len(title) <= _LONGEST_NAME else title[: _LONGEST_NAME - 1] + "…"
    state = "verified" if result["success"] else f"not verified: {result['status']}"
    objective = "none" if result["objective"] is None else f"{result['objective']:.8g}"
    return f"{name}\n{result['method']['name']}, objective {objective}, {state}".strip()


def _label(text: str) -> str:
    """Text without control characters, which no picture format can hold."""
    return "".join(character if character.isprintable() or character == "\n" else " " for character in text)
