"""Every case on board by every method: times of the first and of the next solve, error, miss of the flight.

"cold" is the first solve of a structure in this process, "warm" the next one (the same, where the first takes
long), both build + solve (+ refine); verification is apart. "miss" is the largest scaled error of the states
at the end of the verification flight.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import statistics
import sys
from typing import Any

from solvers.cache import STRUCTURES
from solvers.catalogue import case_names, load_case
from solvers.solution import Solution
from solvers.solve import solve
from solvers.spec import check_document

METHODS: list[dict[str, Any]] = [
    {"name": "swcm", "L": 8, "J": 4},
    {"name": "gpm", "nodes": 65},
    {"name": "hermite_simpson", "intervals": 65},
    {"name": "swcm", "refine": "switching"},
    {"name": "gpm", "adaptive": {"tolerance": 1e-8}},
    {"name": "auto"},
]
WARM_RUNS = 3
# What takes longer than this, in seconds, is solved once.
LONG = 10.0


def spent(solution: Solution) -> float:
    """Seconds of build, solve and refinement."""
    seconds = solution.statistics.seconds
    return seconds["build"] + seconds["solve"] + seconds["refine"]


def row(case: str, method: dict[str, Any]) -> str:
    """One line of the table."""
    document = load_case(case)
    document["method"] = method
    spec = check_document(document)
    STRUCTURES.clear()
    solution = solve(spec)
    cold = warm = spent(solution)
    if cold <= LONG:
        runs = [solve(spec) for _ in range(WARM_RUNS)]
        solution, warm = runs[-1], statistics.median(spent(run) for run in runs)
    reference = document["reference"]["objective"]
    options = ", ".join(f"{key} {value}" for key, value in method.items() if key != "name")
    miss = solution.verification.terminal_error
    return (
        f"| {case} | {method['name']} {options} | {solution.status.value} | {cold:.3f} | {warm:.3f} "
        f"| {solution.objective - reference:+.1e} | {'' if miss is None else f'{miss:.1e}'} |"
    )


def main(names: list[str]) -> None:
    """Print the table for these cases, all without names."""
    print("\n| case | method | status | cold, s | warm, s | objective - reference | miss |")
    print("|---|---|---|---|---|---|---|")
    single = [name for name in case_names() if load_case(name)["method"]["name"] != "piecewise"]
    for case in names or single:
        for method in METHODS:
            print(row(case, method), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
