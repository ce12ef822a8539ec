"""What was found as tables: design, integrals, outputs, arcs, and what was flown with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from app.report.cells import Result, Table, cut, figure, symbol, verdict
from solvers.output.plot import with_unit

_MAXIMA = {
    "terminal_error": "miss at the end",
    "max_state_error": "largest state error",
    "max_bound_violation": "bounds",
    "max_path_violation": "path",
}


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
            (plant, verdict(own["verification"]["passed"]), *_maxima(own["verification"]))
            for plant, own in result["scenarios"].items()
        ]
        yield Table("Plants under this command", ("plant", "verdict", *_MAXIMA.values()), rows)
    if result.get("command"):
        command, flown = result["command"], result["command"]["verification"]
        rows_of = f"{len(command['t'])} rows of {figure(command['period'])}, rule {command['rule']}"
        # A flight of phases tells of the end of each.
        parts: list[tuple[tuple[str, ...], Any]] = [
            ((part["name"],), part["states"]) for part in flown.get("phases", [])
        ]
        yield Table(
            f"Command: {rows_of}, flown as it is",
            (*(["phase"] if parts else []), "state", "at the end", "miss"),
            [
                (*label, symbol(state), figure(own["final"], 10), figure(own["error"], 3))
                for label, states in parts or [((), flown["states"])]
                for state, own in states.items()
            ],
            flown.get("note", ""),
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
        yield cut(Table("Segments", head, rows))


def _maxima(verification: Mapping[str, Any]) -> list[str]:
    return [figure(verification[key], 3) for key in _MAXIMA]


def _arcs(found: Mapping[str, Any], phases: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    times = [phases[0]["t0"], *found["times"], phases[-1]["tf"]]
    return [
        (str(index + 1), figure(times[index], 10), figure(times[index + 1], 10), kind, figure(level))
        for index, (kind, level) in enumerate(zip(found["arcs"], found["levels"], strict=True))
    ]
