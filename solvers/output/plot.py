"""A result as a picture: states, controls and outputs over time, bounds dashed, switches, phases marked.

matplotlib is imported where a picture is drawn, and without pyplot: figures belong to nobody's global state.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from solvers.models import LIBRARY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# matplotlib keeps settings and caches that threads must not share.
_drawing = threading.Lock()

# What a group is called beside its rows, its colour and its line width: apart without colours too.
_GROUPS = {
    "states": ("state", "#17406b", 1.5),
    "controls": ("control", "#c0392b", 2.0),
    "outputs": ("output", "#5d9c5a", 1.5),
}
# Of several plants under one command.
_DASHES: tuple[tuple[float, ...], ...] = ((), (6, 2), (2, 1.5), (6, 2, 1.5, 2), (10, 2), (1, 1))
_ROW_HEIGHT = 1.6
_ROWS_ON_PAPER = 5
_LONGEST_NAME = 80
# More would not be legible above the first row.
_MOST_LABELLED = 12
_STYLE: dict[Any, Any] = {
    # Text stays text: it can be found, selected and read aloud, and prints sharp at any size.
    "svg.fonttype": "none",
    "svg.hashsalt": "ondelette",
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.useoffset": False,
}


@dataclass(frozen=True)
class _Row:
    """A quantity and its curves, by the name of the plant."""

    name: str
    group: str
    curves: Mapping[str, Any]


def render(result: Mapping[str, Any], kind: Literal["svg", "png"], title: str = "") -> bytes:
    """The picture of a result as SVG or PNG."""
    with _drawing:
        return _saved(draw(result, title), kind, title)


def _saved(figure: Figure, kind: Literal["svg", "png"], title: str = "") -> bytes:
    import matplotlib

    with matplotlib.rc_context(_STYLE):
        buffer = io.BytesIO()
        metadata: dict[str, str | None] = {"Title": _label(title)} if title else {}
        if kind == "svg":
            metadata["Date"] = None  # the same picture is the same file
        figure.savefig(buffer, format=kind, dpi=130, metadata=metadata)
    return buffer.getvalue()


def render_parts(result: Mapping[str, Any]) -> Iterator[bytes]:
    """The picture of a result as SVGs of a few rows each, which fit on paper; without its headline."""
    rows = list(_rows(result))
    for start in range(0, len(rows), _ROWS_ON_PAPER):
        with _drawing:
            part = _saved(_figure(result, rows[start : start + _ROWS_ON_PAPER]), "svg")
        yield part


def draw(result: Mapping[str, Any], title: str = "") -> Figure:
    """The picture of a result as a matplotlib figure: a row for each state, control and output.

    Of several plants under one command it shows all, each with its own dashes.
    """
    figure = _figure(result, list(_rows(result)))
    figure.suptitle(_label(_headline(result, title)), parse_math=False, fontsize=11)
    return figure


def _figure(result: Mapping[str, Any], rows: list[_Row]) -> Figure:
    import matplotlib
    from matplotlib.figure import Figure

    units = units_of(result)
    margins = {item["pointer"]: item for item in result["constraints"]}
    switches = sorted({time for found in result["switching"].values() for time in found["times"]})
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(8.0, 1.1 + _ROW_HEIGHT * len(rows)), layout="constrained")
        axes = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
        for axis, row in zip(axes, rows, strict=True):
            _draw_row(axis, row)
            _mark(axis, switches, _bounds(margins.get(f"/problem/bounds/{row.name}")))
            _mark_phases(axis, result["phases"], row.name, margins)
            axis.set_ylabel(with_unit(row.name, units), parse_math=False)
        axes[-1].set_xlabel(with_unit("t", units), parse_math=False)
        _label_switches(axes[0], switches)
        _label_phases(axes[0], result["phases"])
        figure.align_ylabels(axes)
        if len(plants := max((list(row.curves) for row in rows), key=len)) > 1:
            handles = max((axis.get_lines()[: len(plants)] for axis in axes), key=len)
            figure.legend(handles, plants, loc="outside lower center", ncols=len(plants), frameon=False)
    return figure


def units_of(result: Mapping[str, Any]) -> dict[str, str]:
    """Name -> unit, as far as the document of a result, or a model of the library, tells them."""
    problem = result["resolved"]["document"]["problem"]
    units: dict[str, str] = {}
    if problem["model"]["kind"] == "library":
        model = LIBRARY[problem["model"]["name"]].with_options(problem["model"].get("options", {}))
        units.update({name: item.unit for name, item in {**model.states, **model.controls}.items()})
    units.update({item["name"]: item["units"] for item in result.get("outputs", []) if item["units"]})
    units.update(problem.get("units", {}))
    return units


def with_unit(name: str, units: Mapping[str, str]) -> str:
    """A name as a table or an axis shows it, with its unit if there is one."""
    return _label(f"{name} [{units[name]}]" if units.get(name) else name)


def _rows(result: Mapping[str, Any]) -> Iterator[_Row]:
    trajectory = result["trajectory"]
    plants = {name: plant["trajectory"] for name, plant in result.get("scenarios", {}).items()}
    for group in _GROUPS:
        for name, values in trajectory.get(group, {}).items():
            # A rated control is listed with the states too.
            if group == "states" and name in trajectory["controls"]:
                continue
            curves = {plant: (own["t"], own[group][name]) for plant, own in plants.items()}
            if not curves or group == "controls":
                curves = {"": (trajectory["t"], values)}
            yield _Row(name, group, curves)


def _draw_row(axis: Axes, row: _Row) -> None:
    called, colour, width = _GROUPS[row.group]
    for number, (t, values) in enumerate(row.curves.values()):
        # What is not finite (null in a result) leaves a gap.
        (line,) = axis.plot(t, np.array(values, np.float64), color=colour, linewidth=width)
        if dashes := _DASHES[number % len(_DASHES)]:
            line.set_dashes(dashes)
            line.set_linewidth(1.1)
    axis.grid(visible=True, linewidth=0.4, color="#cccccc")
    axis.margins(x=0.01)
    axis.annotate(
        called,
        xy=(1.005, 0.5),
        xycoords="axes fraction",
        rotation=270,
        va="center",
        fontsize=7.5,
        color="#666666",
    )


def _mark(axis: Axes, switches: list[float], bounds: list[float]) -> None:
    for time in switches:
        axis.axvline(time, color="#777777", linewidth=0.8, linestyle=":")
    for bound in bounds:
        axis.axhline(bound, color="#444444", linewidth=0.8, linestyle=(0, (4, 3)))


def _label_switches(axis: Axes, switches: list[float]) -> None:
    """Switching times above the first row, where there are few enough to be read."""
    for time in switches if len(switches) <= _MOST_LABELLED else ():
        axis.annotate(
            f"{time:.5g}",
            xy=(time, 1.02),
            xycoords=("data", "axes fraction"),
            rotation=90,
            ha="center",
            va="bottom",
            fontsize=7,
            color="#444444",
        )


def _label_phases(axis: Axes, phases: Sequence[Mapping[str, Any]]) -> None:
    """Names of phases inside the first row, where there are several."""
    for phase in phases if len(phases) > 1 else ():
        axis.annotate(
            _label(phase["name"]),
            xy=((phase["t0"] + phase["tf"]) / 2.0, 0.98),
            xycoords=("data", "axes fraction"),
            ha="center",
            va="top",
            fontsize=7.5,
            color="#444444",
        )


def _mark_phases(
    axis: Axes, phases: Sequence[Mapping[str, Any]], name: str, margins: Mapping[str, Mapping[str, Any]]
) -> None:
    """Where phases meet, and the bounds that one of them has for itself."""
    for index, phase in enumerate(phases):
        if index:
            axis.axvline(phase["t0"], color="#333333", linewidth=0.9)
        for bound in _bounds(margins.get(f"/problem/phases/{index}/bounds/{name}")):
            span = [phase["t0"], phase["tf"]]
            axis.plot(span, [bound, bound], color="#555555", linewidth=0.8, linestyle="--")


def _bounds(margin: Mapping[str, Any] | None) -> list[float]:
    """The bounds of a quantity that comes to rest on one of them; others would only squeeze the curve."""
    if margin is None or not margin["active"]:
        return []
    return [bound for bound in margin["bounds"] if bound is not None]


def _headline(result: Mapping[str, Any], title: str) -> str:
    name = title if len(title) <= _LONGEST_NAME else title[: _LONGEST_NAME - 1] + "…"
    state = "verified" if result["success"] else result["status"].replace("_", " ")
    objective = "none" if result["objective"] is None else f"{result['objective']:.8g}"
    return f"{name}\n{result['method']['name']}, objective {objective}, {state}".strip()


def _label(text: str) -> str:
    """Text without control characters, which no picture format can hold."""
    return "".join(character if character.isprintable() or character == "\n" else " " for character in text)
