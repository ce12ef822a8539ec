"""ondelette itself, in the same contract. Variants are its methods; N becomes the nearest mesh of each.

Its time is all that a solve takes but the verification, which the peers have not.
Its control is flown as it returned it.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from typing import Any

from contract import Answer, run
from problems import Case

from solvers.catalogue import load_case
from solvers.solve import solve
from solvers.spec import check_document


def method(variant: str, points: int) -> dict[str, Any]:
    """The document's ``method`` for a variant such as "swcm" or "swcm-switching"."""
    name, _, refinement = variant.partition("-")
    spline = {"name": "swcm", "L": 8, "J": round((points - 3) / 8).bit_length() - 1}
    meshes = {
        "swcm": spline,
        "gpm": {"name": "gpm", "nodes": 5, "segments": round(points / 5)},
        "hermite_simpson": {"name": "hermite_simpson", "intervals": (points - 1) // 2},
    }
    if refinement == "switching":
        return {**meshes[name], "refine": "switching"}
    if refinement == "adaptive":
        coarse = {
            "swcm": {"name": "swcm", "adaptive": {"tolerance": 1e-8, "max_level": 20}},
            "gpm": {"name": "gpm", "adaptive": {"tolerance": 1e-8}},
            "hermite_simpson": {"name": "hermite_simpson", "adaptive": {"tolerance": 1e-8}},
        }
        return coarse[name]
    return meshes[name]


def build(case: Case, points: int, variant: str) -> Callable[[], Answer]:
    """The structure of a problem is kept by ondelette's own cache."""
    document = load_case(case.name)
    document["method"] = method(variant, points)

    def again() -> Answer:
        solution = solve(check_document(document))
        seconds = solution.statistics.seconds
        trajectory = solution.trajectory
        times = trajectory.time(trajectory.breakpoints)
        sampled = trajectory.sample(times)
        return Answer(
            objective=solution.objective,
            times=times.tolist(),
            controls=sampled["controls"],
            state_times=times.tolist(),
            states=sampled["states"],
            success=solution.success,
            message=solution.status.value,
            mesh=f"{trajectory.breakpoints.size} breakpoints",
            seconds=seconds["total"] - seconds["verify"],
            miss=solution.verification.terminal_error,
        )

    return again


if __name__ == "__main__":
    run("ondelette", version("ondelette"), build)
