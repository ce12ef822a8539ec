"""Where a bounded control rests on its bounds, and where it switches."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.problem import Interval, OptimalControlProblem
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

# A node counts as on a bound within this part of the range between the bounds.
_ON_BOUND = 0.02
# An interior stretch of fewer nodes than this between two bounds is a switch seen through the mesh.
_SHORTEST_INTERIOR = 4


def find_switching(problem: OptimalControlProblem, trajectory: Trajectory) -> dict[str, Any]:
    """The ``switching`` of a result: for each control with two bounds its switch times, levels and arcs.

    Read off the control on its nodes: a switch is placed where the control crosses the middle between the
    levels of the arcs that meet, so it is as sharp as the mesh. ``times`` lie strictly inside (t0, tf).
    """
    found = {}
    for name, bounds in zip(problem.controls, problem.control_bounds, strict=True):
        if np.isfinite(bounds).all() and bounds[0] < bounds[1]:
            found[name] = _switches(trajectory, name, bounds)
    return found


def _switches(trajectory: Trajectory, name: str, bounds: Interval) -> dict[str, Any]:
    tau = trajectory.nodes
    values = trajectory.controls[name](tau)
    arcs = _arcs(values, bounds)
    times = []
    for (_, last, before), (first, _, after) in pairwise(arcs):
        levels = [_level(kind, bounds) for kind in (before, after)]
        if None in levels:
            times.append(0.5 * (tau[last] + tau[first]))
        else:
            middle = 0.5 * (bounds[0] + bounds[1])
            stretch, crossing = tau[last : first + 1], values[last : first + 1] - middle
            times.append(float(np.interp(0.0, *_ascending(crossing, stretch))))
    return {
        "times": trajectory.time(np.array(times)).tolist(),
        "levels": [_level(kind, bounds) for _, _, kind in arcs],
        "arcs": [kind for _, _, kind in arcs],
    }


def _arcs(values: Vector, bounds: Interval) -> list[tuple[int, int, str]]:
    """Stretches (first node, last node, kind) in order; short interior ones between others are left out."""
    margin = _ON_BOUND * (bounds[1] - bounds[0])
    kinds = np.where(
        values <= bounds[0] + margin, "lower", np.where(values >= bounds[1] - margin, "upper", "interior")
    )
    edges = np.flatnonzero(kinds[1:] != kinds[:-1]) + 1
    starts, stops = [0, *edges.tolist()], [*edges.tolist(), values.size]
    runs = [(start, stop - 1, str(kinds[start])) for start, stop in zip(starts, stops, strict=True)]
    lasting = [
        run
        for run in runs
        if len(runs) == 1 or run[2] != "interior" or run[1] - run[0] + 1 >= _SHORTEST_INTERIOR
    ]
    merged: list[tuple[int, int, str]] = []
    for run in lasting or runs[:1]:
        if merged and merged[-1][2] == run[2]:
            run = (merged.pop()[0], *run[1:])
        merged.append(run)
    return merged


def _level(kind: str, bounds: Interval) -> float | None:
    return {"lower": bounds[0], "upper": bounds[1]}.get(kind)


def _ascending(crossing: Vector, tau: Vector) -> tuple[Vector, Vector]:
    """Abscissae and ordinates for inverse interpolation, made ascending."""
    return (crossing, tau) if crossing[-1] > crossing[0] else (crossing[::-1], tau[::-1])
