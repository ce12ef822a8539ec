"""Draws the figures of docs/methods/genetic.md: the paper's examples, by scaling functions and superimposed.

.venv/bin/python benchmarks/genetic_figures.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from solvers.catalogue import load_case
from solvers.solve import solve
from solvers.spec import check_document
from solvers.trajectory import Trajectory

FIGURES = Path(__file__).parents[1] / "docs" / "methods" / "genetic"
EXAMPLES = {"1": "Example 1: attitude regained", "2neg": "Example 2: attitude turned by -45 degrees"}
BASES = {0: "scaling functions", 1: "wavelets superimposed"}


def answer(case: str, **method: Any) -> Trajectory:
    """The trajectory of a case by a method."""
    document = load_case(f"solar_array_{case}") | {"method": method}
    return solve(check_document(document)).trajectory


def draw(case: str, levels: int) -> None:
    """One figure: states and controls by the paper's operators, of the optima in the basis and without it."""
    curves = {
        "operators of the paper": (
            answer(case, name="ga", variant="classic", polish=False, wavelet_levels=levels),
            {"linewidth": 0.8, "alpha": 0.7},
        ),
        "optimum in the basis": (answer(case, name="ga", wavelet_levels=levels), {"linewidth": 1.6}),
        "optimum": (answer(case, name="gpm", nodes=30), {"linewidth": 1.0, "linestyle": "--"}),
    }
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.6), constrained_layout=True)
    tau = np.linspace(0.0, 1.0, 321)
    for trajectory, style in curves.values():
        for axes, group in ((left, trajectory.states), (right, trajectory.controls)):
            for index, (name, curve) in enumerate(group.items()):
                label = name if style["linewidth"] == 1.6 else None
                axes.plot(trajectory.time(tau), curve(tau), color=f"C{index}", label=label, **style)
    for axes, title in ((left, "angles, rad"), (right, "hinge rates, rad/s")):
        axes.set(title=title, xlabel="t, s")
        axes.legend(fontsize="small", frameon=False)
        axes.grid(visible=True, linewidth=0.3)
    figure.suptitle(
        f"{EXAMPLES[case]}, {BASES[levels]} (thick: optimum in the basis; thin: the paper's operators; "
        "dashed: optimum)",
        fontsize=9,
    )
    figure.savefig(FIGURES / f"example_{case}_{levels}.svg", metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    mpl.use("svg")
    mpl.rcParams |= {"svg.hashsalt": "ondelette", "svg.fonttype": "none", "path.simplify_threshold": 0.3}
    FIGURES.mkdir(parents=True, exist_ok=True)
    for example in EXAMPLES:
        for level in BASES:
            draw(example, level)
