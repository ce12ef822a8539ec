"""How large the nonlinear program of a document is, and about how long it takes, without building it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from solvers.problem import Interval
from solvers.spec import (
    AutoMethod,
    GaussPseudospectralMethod,
    HermiteSimpsonMethod,
    JobSpec,
    MechanicalModel,
    ProblemSpec,
    SplineWaveletMethod,
    bound_interval,
    final_intervals,
    initial_intervals,
    path_intervals,
)


@dataclass(frozen=True)
class ProblemSize:
    """Unknowns, constraint rows, nodes, and an estimate of the solve time in seconds."""

    variables: int
    constraints: int
    nodes: int
    seconds: float


# How much longer than the first mesh all meshes of the cases took.
_ADAPTIVE_MESHES = 5


def problem_size(spec: JobSpec) -> ProblemSize:
    """The size of the program that the method of this document builds on its finest mesh.

    Of an adaptive mesh this is the first one. The seconds are those of a refinement too, which takes about as
    long again, and of some meshes more where these adapt.
    """
    size = _mesh_size(spec)
    passes = (1 if spec.method.refinement is None else 2) + (
        0 if spec.method.adaptivity is None else _ADAPTIVE_MESHES
    )
    return replace(size, seconds=passes * size.seconds)


def _mesh_size(spec: JobSpec) -> ProblemSize:
    problem = spec.problem
    n, m = len(problem.model.states), len(problem.model.controls)
    match spec.method:
        case GaussPseudospectralMethod(nodes=nodes, segments=segments):
            states, controls = segments * (nodes + 1) + 1, segments * nodes
            size = _size(problem, n * states + m * controls, n * (states - 1), controls, states)
            return _timed(size, 2e-9 * nodes**3 * segments * n**2)
        case HermiteSimpsonMethod(intervals=intervals):
            nodes = 2 * intervals + 1
            return _timed(_size(problem, (n + m) * nodes, 2 * n * intervals, nodes, nodes), 0.0)
        case SplineWaveletMethod(L=length, first_level=level):
            return _spline_size(problem, length << level)
        case AutoMethod():
            default = SplineWaveletMethod(name="swcm")
            return _spline_size(problem, default.L << default.J)
    raise TypeError(f"no size for the method {spec.method!r}")


def _spline_size(problem: ProblemSpec, intervals: int) -> ProblemSize:
    n, m = len(problem.model.states), len(problem.model.controls)
    if isinstance(problem.model, MechanicalModel):
        splines, points = n // 2, intervals + 1
    else:
        splines, points = n, intervals + 2
    variables = splines * (intervals + 3) + m * points
    held = _held_rows(problem, splines, intervals + 1)
    size = _size(problem, variables, splines * points + held, points, intervals + 3)
    return _timed(size, 0.0)


def _held_rows(problem: ProblemSpec, splines: int, knots: int) -> int:
    """Rows that hold splines and their rates at the knots; a spline at an end is an unknown itself."""
    along = path_intervals(problem)
    ends = initial_intervals(problem), final_intervals(problem)
    rows = 0
    for index, name in enumerate(problem.model.states):
        inner = along[name]
        at_ends = [_meet(inner, end[name]) for end in ends]
        if index < splines:
            rows += (knots - 2) * bool(np.isfinite(inner).any())
        else:
            rows += (knots - 2) * _sides(inner) + sum(_sides(end) for end in at_ends)
    return rows


def _size(problem: ProblemSpec, variables: int, defects: int, path_points: int, nodes: int) -> ProblemSize:
    """Add the times, the path and boundary constraints, and the order of the times."""
    parameters = problem.model.parameter_values()
    initial, final = (
        bound_interval(bound, parameters) for bound in (problem.initial_time, problem.final_time)
    )
    rows = defects + len(problem.path_constraints) * path_points + len(problem.boundary_constraints)
    return ProblemSize(variables + 2, rows + (final[0] <= initial[1]), nodes, 0.0)


def _timed(size: ProblemSize, dense: float) -> ProblemSize:
    """Seconds, from what the cases took: about 30 iterations, linear in the unknowns where sparse."""
    return ProblemSize(
        size.variables, size.constraints, size.nodes, 0.03 + 1e-4 * size.variables + 30 * dense
    )


def _sides(interval: Interval) -> int:
    return 1 if interval[0] == interval[1] else int(np.isfinite(interval).sum())


def _meet(first: Interval, second: Interval) -> Interval:
    return max(first[0], second[0]), min(first[1], second[1])
