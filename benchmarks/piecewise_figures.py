"""Draws the figures of the published missions: as published (left) and with look-ahead (right).

.venv/bin/python benchmarks/piecewise_figures.py
"""

from __future__ import annotations

import math
import runpy
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solvers.catalogue import load_case
from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]
Row = tuple[str, Callable[["Flight"], Sequence[Vector]], Sequence[float]]

HERE = Path(__file__).parent
FIGURES = HERE.parent / "docs" / "methods"
BENCH = runpy.run_path(str(HERE / "piecewise.py"))
POINTS = 600
RADIUS = 6_378_137.0


class Flight:
    """The tracked trajectory of a mission, sampled for a picture."""

    def __init__(self, document: dict[str, Any], unit: float) -> None:
        patient = document | {"options": {**document.get("options", {}), "max_seconds": 600}}
        result = solve(check_document(patient)).result()
        curves = Trajectory.from_result(result)
        tau = np.linspace(0.0, 1.0, POINTS)
        self.time = curves.time(tau) / unit
        self.values = dict(zip(curves.states, curves.states_at(tau), strict=True))
        self.values |= dict(zip(curves.controls, curves.controls_at(tau), strict=True))
        self.segments = result["segments"]

    def deorbit_rate(self) -> Vector:
        """Loss of mean height over each segment, km/h, at the sampled times."""
        middles = np.array([(item["t0"] + item["tf"]) / 2 for item in self.segments])
        means = np.array([np.mean(item["tracked"]["states"]["p"]) for item in self.segments])
        rates = -3.6 * np.diff(means) / np.diff(middles)
        return np.interp(self.time * 3600.0, (middles[1:] + middles[:-1]) / 2, rates)


def angles(*names: str) -> Callable[[Flight], list[Vector]]:
    """Angles in degrees."""
    return lambda flight: [np.degrees(flight.values[name]) for name in names]


def plain(*names: str, scale: float = 1.0) -> Callable[[Flight], list[Vector]]:
    """Quantities as they are, or scaled."""
    return lambda flight: [scale * flight.values[name] for name in names]


def draw(name: str, flights: Sequence[Flight], rows: Sequence[Row], unit: str) -> None:
    """A column for each flight, a row for each quantity; bounds dashed."""
    figure = Figure(figsize=(10.0, 1.7 * len(rows) + 0.6), layout="constrained")
    axes = figure.subplots(len(rows), 2, sharex="col", squeeze=False)
    for column, (flight, title) in enumerate(zip(flights, ("as published", "with look-ahead"), strict=True)):
        axes[0, column].set_title(title, fontsize=10)
        axes[-1, column].set_xlabel(unit)
        for axis, (label, values, bounds) in zip(axes[:, column], rows, strict=True):
            for line in values(flight):
                axis.plot(flight.time, line, linewidth=0.9)
            for bound in bounds:
                axis.axhline(bound, color="#555555", linewidth=0.8, linestyle="--")
            axis.set_ylabel(label, fontsize=8)
            axis.grid(visible=True, linewidth=0.4, alpha=0.5)
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": "ondelette"}):
        figure.savefig(FIGURES / f"{name}.svg", metadata={"Date": None})


def main() -> None:
    """Write both figures beside the page."""
    tether = [
        Flight(document, 3600.0)
        for document in (BENCH["variant"]("edt_igrf", BENCH["dipole_predictions"]), load_case("edt_igrf"))
    ]
    limit = [-45.0, 45.0]
    draw(
        "piecewise-deorbit",
        tether,
        (
            ("current, A", plain("I"), [0.4]),
            ("pitch, deg", angles("alpha"), limit),
            ("roll, deg", angles("beta"), limit),
            ("height, km", lambda flight: [(flight.values["p"] - RADIUS) / 1000.0], [700.0]),
            ("deorbit rate, km/h", lambda flight: [flight.deorbit_rate()], []),
        ),
        "h",
    )
    elevator = [
        Flight(document, 1.0)
        for document in (BENCH["variant"]("pse", BENCH["small_angles"]), load_case("pse"))
    ]
    most = math.degrees(0.3)
    draw(
        "piecewise-elevator",
        elevator,
        (
            ("theta1, theta2, deg", angles("th1", "th2"), [-most, most]),
            ("L1, km", plain("L1", scale=1e-3), []),
            ("Lc, km", plain("Lc", scale=1e-3), [-5.0, 5.0]),
            ("L1', m/s", plain("L1_dot"), [-25.0, -15.0]),
            ("Lc', m/s", plain("Lc_dot"), [-10.0, 10.0]),
            ("T1, T2, N", plain("T1", "T2"), [0.0, 200.0]),
        ),
        "s",
    )


if __name__ == "__main__":
    main()
