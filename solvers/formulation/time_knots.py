"""Where data tables over time have corners: mesh points of every method, breakpoints of every flight.

Only tables with corners count (`linear`, `previous`) that an expression calls with the time itself, as in
``Td(t)``. On a mesh in normalised time they stand still where initial and final time are fixed.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from solvers.bases.graded import FINEST, GradedKnots
from solvers.expressions import Expression
from solvers.formulation.data_table import DataTable, calls
from solvers.problem import OptimalControlProblem
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

# A point of a mesh this close to a corner, in parts of its interval, gives way to it.
_CLOSE = 0.25
# Levels by which the dyadic intervals at a corner are finer, and how many intervals all corners may cost.
_DEEPER = 9
_MOST_ADDED = 4096
_SAME = 1e-10
# A flight that ends so near to the end of a table, as a part of its duration, is ended by it.
_REACHED = 1e-6
# Half of an interval in which the model jumps, in normalised time.
_MOMENT = 1e-9
LONGEST_MOMENT = 4 * _MOMENT
"""An interval that is shorter than this is there for a jump of the model."""


def corner_times(problem: OptimalControlProblem, *, jumps_only: bool = False) -> Vector:
    """The ascending times at which a table that is called in t has a corner, or jumps."""
    tables = [_table(problem, name) for name in _called(problem, in_time=True)]
    wanted = [
        table.x
        for table in tables
        if table.has_corners and (table.interpolation == "previous" or not jumps_only)
    ]
    return np.unique(np.array(list(chain.from_iterable(wanted)), np.float64))


def has_fixed_times(problem: OptimalControlProblem) -> bool:
    """Whether initial and final time are given numbers."""
    return all(lower == upper for lower, upper in (problem.initial_time, problem.final_time))


def mesh_corners(problem: OptimalControlProblem, *, jumps_only: bool = False) -> Vector:
    """The corners of the flight in normalised time; none where they move with a free time."""
    if not has_fixed_times(problem):
        return np.zeros(0)
    t0, tf = problem.initial_time[0], problem.final_time[0]
    return _inside((corner_times(problem, jumps_only=jumps_only) - t0) / (tf - t0))


def flight_corners(problem: OptimalControlProblem, trajectory: Trajectory) -> Vector:
    """The corners of a flight in its normalised time."""
    return _inside((corner_times(problem) - trajectory.t0) / trajectory.duration)


def with_corners(breaks: Vector, corners: Vector) -> Vector:
    """The breaks (ascending from 0 to 1) and all corners; what is close to a corner gives way to it."""
    if not corners.size:
        return breaks
    widths = np.diff(breaks)
    room = _CLOSE * np.minimum(np.append(widths, np.inf), np.append(np.inf, widths))
    distance = np.min(np.abs(breaks[:, None] - corners), axis=1)
    kept = distance > room
    kept[[0, -1]] = True
    return np.union1d(breaks[kept], corners)


def with_moments(breaks: Vector, jumps: Vector) -> Vector:
    """The breaks with a short interval around each jump in place of the jump: its ends see one side each."""
    if not jumps.size:
        return breaks
    kept = np.setdiff1d(breaks, jumps)
    return np.union1d(kept, np.concatenate([jumps - _MOMENT, np.minimum(jumps + _MOMENT, 1.0)]))


def refined_at(knots: GradedKnots, corners: Vector) -> GradedKnots:
    """Dyadic knots that are finer at the corners: by 9 levels, unless that adds more than 4,096 intervals."""
    largest = knots.intervals + _MOST_ADDED
    for _ in range(_DEEPER if corners.size else 0):
        at = np.concatenate([np.searchsorted(knots.knots, corners, side) for side in ("left", "right")]) - 1
        levels = knots.levels.copy()
        levels[np.unique(np.clip(at, 0, levels.size - 1))] += 1
        finer = knots.adapted(np.minimum(levels, FINEST))
        if finer.intervals > largest:
            break
        knots = finer
    return knots


def corner_warnings(problem: OptimalControlProblem) -> list[dict[str, str]]:
    """Tables whose corners no mesh can meet, for they are called otherwise or move with a free time."""
    found = []
    elsewhere = set(_called(problem, in_time=False))
    for name, item in problem.definitions.items():
        if not isinstance(item, DataTable) or not item.has_corners:
            continue
        if name in elsewhere:
            code = "nonsmooth"
            detail = (
                f"The table '{name}' has corners in what it is called with; "
                "the optimizer expects smooth functions: take interpolation 'cubic'."
            )
        elif name in _called(problem, in_time=True) and _moves_over(problem, item):
            code = "table_corners_off_mesh"
            detail = (
                f"The corners of '{name}' are no points of the mesh, which moves with the free times; they"
                " cost accuracy near them. The verification meets them exactly. Let a phase end there, at"
                " that given time, and they cost nothing."
            )
        else:
            continue
        found.append({"code": code, "pointer": f"/problem/data/{name}", "detail": detail})
    return found


def _moves_over(problem: OptimalControlProblem, table: DataTable) -> bool:
    """Whether a corner of a table may be inside of a flight whose times are free."""
    first, last = problem.initial_time[0], problem.final_time[1]
    return not has_fixed_times(problem) and any(first < corner < last for corner in table.x)


def tables_that_end(problem: OptimalControlProblem, trajectory: Trajectory) -> list[dict[str, str]]:
    """Warnings of tables over time that end in an error where the flight does, which could end later."""
    first, last = problem.final_time
    if first == last or trajectory.tf < last - _REACHED * trajectory.duration:
        return []
    return [
        {
            "code": "table_ends_flight",
            "pointer": f"/problem/data/{name}",
            "detail": f"The flight ends at t = {last:.6g}, for the table '{name}' has no values beyond it.",
        }
        for name in sorted({*_called(problem, in_time=True)})
        if (table := _table(problem, name)).outside == "error" and table.x[-1] == last
    ]


def _inside(tau: Vector) -> Vector:
    """Those inside of the flight, and one at its end, where a jump comes after the flight."""
    tau = np.where(np.abs(tau - 1.0) <= _SAME, 1.0, tau)
    return tau[(tau > _SAME) & (tau <= 1.0)]


def _table(problem: OptimalControlProblem, name: str) -> DataTable:
    table = problem.definitions[name]
    assert isinstance(table, DataTable)
    return table


def _called(problem: OptimalControlProblem, *, in_time: bool) -> Iterator[str]:
    """Yield the tables that some expression calls with t itself, or with anything else."""
    for expression in along(problem):
        yield from (name for name, with_time in calls(expression) if with_time is in_time)


def along(problem: OptimalControlProblem) -> Iterator[Expression]:
    """Yield what is evaluated along the trajectory."""
    yield from problem.dynamics.expressions
    yield from (item for item in problem.definitions.values() if isinstance(item, Expression))
    yield from (item.expression for item in problem.path)
    yield from (item.expression for item in problem.integrals)
    yield from (item for item in (problem.running_cost, problem.peak_cost) if item is not None)
