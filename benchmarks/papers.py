"""The three papers that the methods come from, reproduced: their tables and figures, ours beside theirs.

    .venv/bin/python benchmarks/papers.py [flexible] [solar] [tethers]

Writes the tables into the pages of docs/papers, between ``<!-- NAME -->`` and ``<!-- end -->``, and draws the
figures beside the pages. The first takes seconds, the others some minutes. What is printed in the papers
stands here with the number of its table.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import re
import runpy
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from solvers.catalogue import load_case
from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory

HERE = Path(__file__).parent
PAGES = HERE.parent / "docs" / "papers"

Result = dict[str, Any]

# Zhang, Feng, Tang, Macdonald (2014): points -> t_f by GPM, by SWCM; seconds by GPM, by SWCM.
TABLE_1 = {
    19: (2.0043, 2.0068, 1.880650, 0.07695),
    35: (2.0013, 2.0032, 3.342077, 0.192254),
    67: (2.0004, 2.0023, 6.496522, 0.413161),
}
TABLE_2 = {131: (25.86, 25.97, 16.74, 15.85), 259: (25.86, 25.92, 38.54, 35.21)}
# Zhang, Ge, Liu (1999), section 4: example -> J by scaling functions, with wavelets superimposed.
ENERGIES = {"1": (4.624865, 4.589580), "2": (9.213321, 8.636225), "2neg": (9.213321, 8.636225)}


# (60) of the first paper, which does not follow from (59).
PRINTED_DAMPING = [
    ["-2*m*R*L*sin(alpha)*(alpha_dot - theta_dot)", "-2*m*R*L*sin(alpha)*alpha_dot"],
    ["-2*m*R*L*sin(alpha)*alpha_dot", 0],
]


def solved(case: str, method: dict[str, Any], **model: Any) -> tuple[Result, float]:
    """The result of a case by a method, and the seconds of a second solve, verification apart."""
    document = load_case(case) | {"method": method}
    document["problem"]["model"] |= model
    spec = check_document(document)
    solve(spec)
    started = time.perf_counter()
    result = solve(spec).result()
    return result, time.perf_counter() - started - result["statistics"]["seconds"]["verify"]


def level_of(points: int) -> int:
    """J with 2^J 8 + 3 points."""
    return int(np.log2((points - 3) / 8))


def verdict(result: Result) -> str:
    """Whether an answer may be flown, or the check that it fails by most."""
    if result["success"]:
        return "yes"
    worst = max(result["verification"]["checks"], key=lambda check: check["value"] / check["limit"])
    return f"no: {worst['name'].replace('_', ' ')} {worst['value']:.1%}"


def minimum_times(case: str, table: dict[int, tuple[float, ...]]) -> list[str]:
    """Rows of a table of the first paper: points, and for both methods t_f and seconds, theirs and ours."""
    rows = []
    for points, (gpm, swcm, gpm_seconds, swcm_seconds) in table.items():
        gauss, gauss_time = solved(case, {"name": "gpm", "nodes": points})
        spline, spline_time = solved(case, {"name": "swcm", "L": 8, "J": level_of(points)})
        rows.append(
            f"| {points} | {gpm} | {gauss['final_time']:.5f} | {verdict(gauss)} | {gpm_seconds:.2f} "
            f"| {gauss_time:.3f} | {swcm} | {spline['final_time']:.5f} | {verdict(spline)} "
            f"| {swcm_seconds:.2f} | {spline_time:.3f} |"
        )
    return rows


def refined() -> list[str]:
    """Minimum time and switching times of the slew, with the switching times as unknowns."""
    method = {"name": "swcm", "L": 8, "J": 4, "refine": "switching"}
    rows = []
    for label, model in (("as (59) implies", {}), ("as (60) is printed", {"damping": PRINTED_DAMPING})):
        result, seconds = solved("flexible_spacecraft", method, **model)
        times = ", ".join(f"{instant:.6f}" for instant in result["switching"]["T"]["times"])
        miss = result["verification"]["terminal_error"]
        rows.append(f"| {label} | {result['final_time']:.9f} | {times} | {miss:.0e} | {seconds:.3f} |")
    return rows


def write(page: str, name: str, heads: Sequence[str], rows: Sequence[str]) -> None:
    """Put a table into its place in a page. Raises ValueError where there is none."""
    path = PAGES / f"{page}.md"
    table = "\n".join([f"| {' | '.join(heads)} |", "|" + "---|" * len(heads), *rows])
    text, found = re.subn(
        rf"(<!-- {name} -->\n).*?(<!-- end -->)",
        lambda places: f"{places[1]}\n{table}\n\n{places[2]}",
        path.read_text(),
        flags=re.DOTALL,
    )
    if found != 1:
        raise ValueError(f"{path} has {found} places for {name}")
    path.write_text(text)


def save(figure: Figure, name: str) -> None:
    """Write a figure that is the same every time."""
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "ondelette"}):
        figure.savefig(PAGES / f"{name}.svg", metadata={"Date": None})


def draw_minimum_time(case: str, points: Sequence[int], states: Sequence[str], name: str) -> None:
    """Controls for each number of points by both methods and exactly; then the states."""
    exact = trajectory(case, {"name": "swcm", "refine": "switching"})
    panels = len(points) + bool(states)
    figure = Figure(figsize=(4.2 * panels, 3.0), layout="constrained")
    axes = figure.subplots(1, panels, squeeze=False)[0]
    tau = np.linspace(0.0, 1.0, 2001)
    (control,) = exact.controls
    for axis, count in zip(axes, points, strict=False):
        for label, curves, style in (
            ("gpm", trajectory(case, {"name": "gpm", "nodes": count}), {"linewidth": 0.8}),
            ("swcm", trajectory(case, {"name": "swcm", "J": level_of(count)}), {"linewidth": 1.4}),
            ("exact", exact, {"linewidth": 0.9, "linestyle": "--", "color": "black"}),
        ):
            axis.plot(curves.time(tau), curves.controls[control](tau), label=label, **style)
        axis.set(title=f"{control}, {count} points", xlabel="t")
        axis.legend(fontsize="small", frameon=False)
    for state in states:
        axes[-1].plot(exact.time(tau), exact.states[state](tau), label=state)
    if states:
        axes[-1].set(title="angles, rad", xlabel="t")
        axes[-1].legend(fontsize="small", frameon=False)
    for axis in axes:
        axis.grid(visible=True, linewidth=0.3)
    save(figure, name)


def trajectory(case: str, method: dict[str, Any]) -> Trajectory:
    """The curves of a case by a method."""
    return solve(check_document(load_case(case) | {"method": method})).trajectory


def flexible() -> None:
    """The spline wavelet collocation method: tables 1 and 2, figures 3, 4, 6, 7 and 8."""
    heads = ["points", "GPM, paper", "here", "flies?", "s, paper", "s"]
    heads += ["SWCM, paper", "here", "flies?", "s, paper", "s"]
    write("flexible-spacecraft", "table 1", heads, minimum_times("rigid_body", TABLE_1))
    write("flexible-spacecraft", "table 2", heads, minimum_times("flexible_spacecraft", TABLE_2))
    heads = ["C of the model", "t_f, s", "switching times, s", "miss of the flight", "s"]
    write("flexible-spacecraft", "refined", heads, refined())
    draw_minimum_time("rigid_body", (35, 67), (), "rigid-body")
    draw_minimum_time("flexible_spacecraft", (131, 259), ("theta", "alpha"), "flexible-spacecraft")


def energies(case: str) -> list[str]:
    """Rows of an example of the second paper: J by scaling functions, then with wavelets."""
    name = f"solar_array_{case}"
    best, _ = solved(name, {"name": "gpm", "nodes": 30})
    rows = []
    for levels, printed in enumerate(ENERGIES[case]):
        basis = {"name": "ga", "wavelet_levels": levels}
        exact, _ = solved(name, basis)
        operators, _ = solved(name, basis | {"variant": "classic", "polish": False})
        rows.append(
            f"| {case} | {15 * (levels + 1)} | {printed:.6f} | {operators['energy']:.6f} "
            f"| {operators['residual']:.3f} | {exact['objective']:.6f} | {best['objective']:.6f} |"
        )
    return rows


def solar() -> None:
    """The genetic algorithm on the solar array: the energies of section 4, figures 3 to 6."""
    heads = ["example", "functions", "J, paper", "J by its operators, seed 0", "end missed by, rad"]
    heads += ["optimum in the basis, exact ends", "optimum of any control"]
    write("solar-array", "energies", heads, [row for case in ENERGIES for row in energies(case)])
    runpy.run_path(str(HERE / "genetic_figures.py"), run_name="__main__")


def tethers() -> None:
    """The piecewise algorithm: the missions of section 3 as published and as they are on board."""
    bench = runpy.run_path(str(HERE / "piecewise.py"))
    variant = bench["variant"]
    rows = []
    for label, document in (
        ("elevator, as published", variant("pse", bench["small_angles"])),
        ("elevator, with look-ahead", load_case("pse")),
        ("deorbit in the dipole's field, as published", variant("edt_dipole", bench["chapter"])),
        ("deorbit in the dipole's field, with look-ahead", load_case("edt_dipole")),
        ("deorbit in IGRF, as published", variant("edt_igrf", bench["dipole_predictions"])),
        ("deorbit in IGRF, with look-ahead", load_case("edt_igrf")),
    ):
        rows.append(bench["row"](label, document).rpartition(" | ")[0].rpartition(" | ")[0] + " |")
    heads = ["mission", "status", "final time", "largest angles", "tracking error", "prediction, ms"]
    write("tethers", "missions", heads, rows)
    heads = ["switch at 20 deg, off for 10 min", "to 700 km", "pitch, roll", "duty"]
    write("tethers", "baseline", heads, [bench["on_off"](name) for name in ("edt_dipole", "edt_igrf")])
    runpy.run_path(str(HERE / "piecewise_figures.py"), run_name="__main__")


PAPERS = {"flexible": flexible, "solar": solar, "tethers": tethers}

if __name__ == "__main__":
    for paper in sys.argv[1:] or PAPERS:
        PAPERS[paper]()
