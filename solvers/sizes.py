"""How large the nonlinear program of a document is, and about how long it takes, without building it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solvers.bases.legendre import legendre_gauss
from solvers.formulation.quantities import Interval
from solvers.formulation.scenarios import formulate
from solvers.formulation.time_knots import LONGEST_MOMENT
from solvers.genetic.basis import basis_of
from solvers.mesh_points import gauss_mesh, interval_mesh, spline_mesh
from solvers.phases.problem import PhasedProblem
from solvers.phases.scenarios import formulate_phases
from solvers.piecewise.driven import driven_states
from solvers.piecewise.plan import Plan
from solvers.problem import OptimalControlProblem
from solvers.spec import (
    AutoMethod,
    GaussPseudospectralMethod,
    GeneticMethod,
    HermiteSimpsonMethod,
    JobSpec,
    Method,
    PiecewiseMethod,
    SplineWaveletMethod,
)

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class ProblemSize:
    """Unknowns, constraint rows, nodes, and an estimate of the solve time in seconds."""

    variables: int
    constraints: int
    nodes: int
    seconds: float


# What two processes take to be ready for the first prediction.
_START_SECONDS = 1.0
# Seconds of an evaluation of an individual, for each state.
_EVALUATION = 5e-6
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
    if spec.problem.phases:
        flight = formulate_phases(spec.problem, spec.implied_tolerance())
        return _flight_size(flight.problem, spec.method)
    formulation = formulate(spec.problem, spec.implied_tolerance())
    match spec.method:
        case PiecewiseMethod():
            problem = formulation.plants[0].problem
        case GeneticMethod():
            problem = formulation.simulated
        case _:
            problem = formulation.problem
    return _size_with(spec.method, problem)


def _flight_size(problem: PhasedProblem, method: Method) -> ProblemSize:
    """The programs of all phases, and the rows that join them."""
    sizes = [_size_with(method, phase.problem) for phase in problem.phases]
    joints = problem.joints + len(problem.totals) + len(problem.boundary)
    return ProblemSize(
        sum(size.variables for size in sizes),
        sum(size.constraints for size in sizes) + joints,
        sum(size.nodes for size in sizes),
        sum(size.seconds for size in sizes),
    )


def _size_with(method: Method, problem: OptimalControlProblem) -> ProblemSize:
    n, m = len(problem.states), len(problem.controls)
    match method:
        case GaussPseudospectralMethod(nodes=nodes, segments=segments):
            breaks, counts = gauss_mesh(problem, nodes, segments)
            controls = sum(counts)
            states = controls + len(counts) + 1
            ends = [*problem.initial_control, *problem.final_control] if nodes > 1 else []
            size = _size(
                problem,
                n * states + m * controls,
                n * (states - 1) + sum(bool(np.isfinite(end).any()) for end in ends),
                lambda: _gauss_points(breaks, counts),
                states,
            )
            return _timed(size, 2e-9 * sum(count**3 for count in counts) * n**2)
        case HermiteSimpsonMethod(intervals=intervals):
            knots = interval_mesh(problem, intervals)
            nodes, count = 2 * knots.size - 1, knots.size - 1
            points = np.sort(np.concatenate([knots, (knots[1:] + knots[:-1]) / 2.0]))
            moments = int(np.sum(np.diff(knots) < LONGEST_MOMENT))
            rows = (2 * n + len(problem.rated)) * count + (m - len(problem.rated)) * moments
            return _timed(_size(problem, (n + m) * nodes, rows, lambda: points, nodes), 0.0)
        case SplineWaveletMethod(L=length, first_level=level):
            return _spline_size(problem, spline_mesh(problem, length, level).knots)
        case PiecewiseMethod():
            return _mission_size(problem, method)
        case GeneticMethod():
            return _genetic_size(problem, method)
        case AutoMethod():
            default = SplineWaveletMethod(name="swcm")
            return _spline_size(problem, spline_mesh(problem, default.L, default.J).knots)
    raise TypeError(f"no size for the method {method!r}")


def _mission_size(problem: OptimalControlProblem, method: PiecewiseMethod) -> ProblemSize:
    """The program of the first prediction, and the seconds of all that may be needed."""
    plan = Plan.of(method, problem)
    driven = range(len(problem.states)) if plan.state is not None else driven_states(problem)
    bounded = sum(bool(np.isfinite(problem.state_bounds[index]).any()) for index in driven)
    mesh = plan.mesh(0)
    nodes, softened = mesh.instants, bounded * mesh.soft
    variables = (len(driven) + len(problem.controls)) * nodes + softened + 2
    rows = len(driven) * (nodes - 1) + 2 * softened
    rows += len(problem.path) * mesh.local.size + len(problem.boundary)
    prediction = _timed(ProblemSize(variables, rows, nodes, 0.0), 0.0)
    return replace(prediction, seconds=_START_SECONDS + plan.count * prediction.seconds)


def _genetic_size(problem: OptimalControlProblem, method: GeneticMethod) -> ProblemSize:
    """The size of the polish, and the genes alone without one; the time is that of all generations."""
    basis = basis_of(method)
    intervals = basis.units << basis.answer_level
    n, nodes = len(problem.states), 2 * intervals + 1
    genes = len(problem.controls) * basis.size
    seconds = _EVALUATION * method.population * method.budget() * n
    if not method.polish:
        return ProblemSize(genes, 0, nodes, seconds)
    held = [*problem.control_bounds] * nodes + [*problem.initial_control, *problem.final_control]
    rows = 2 * n * intervals + sum(bool(np.isfinite(interval).any()) for interval in held)
    points = np.linspace(0.0, 1.0, nodes)
    size = _timed(_size(problem, n * nodes + genes, rows, lambda: points, nodes), 0.0)
    return replace(size, seconds=seconds + size.seconds)


def _gauss_points(breaks: Vector, counts: Sequence[int]) -> Vector:
    pieces = zip(breaks[:-1], np.diff(breaks), counts, strict=True)
    return np.concatenate(
        [start + width * (legendre_gauss(count)[0] + 1.0) / 2.0 for start, width, count in pieces]
    )


def _spline_size(problem: OptimalControlProblem, knots: Vector) -> ProblemSize:
    n, m, ramps = len(problem.states), len(problem.controls), len(problem.rated)
    intervals = knots.size - 1
    splines, points = problem.dynamics.coordinates, knots
    if not splines:
        splines, points = n - ramps, np.concatenate([[0.0], (knots[1:] + knots[:-1]) / 2.0, [1.0]])
    # A control is a value at every point; a rated one also has a rate between any two of them.
    variables = splines * (intervals + 3) + m * points.size + ramps * (points.size - 1)
    rows = splines * points.size + ramps * (points.size - 1)
    rows += _held_rows(problem, splines, knots.size)
    sides = np.repeat(points, 2)[1:-1] if ramps else points
    return _timed(_size(problem, variables, rows, lambda: sides, intervals + 3), 0.0)


def _held_rows(problem: OptimalControlProblem, splines: int, knots: int) -> int:
    """Rows that hold splines and their rates at the knots; a spline at an end is an unknown itself."""
    rows = 0
    every = zip(problem.state_bounds, problem.initial_state, problem.final_state, strict=True)
    for index, (inner, *ends) in enumerate(every):
        if index >= len(problem.states) - len(problem.rated):
            continue
        if index < splines:
            rows += (knots - 2) * bool(np.isfinite(inner).any())
        else:
            rows += (knots - 2) * _sides(inner) + sum(_sides(_meet(inner, end)) for end in ends)
    return rows


def _size(
    problem: OptimalControlProblem,
    variables: int,
    rows: int,
    path_points: Callable[[], Vector],
    nodes: int,
) -> ProblemSize:
    """Add the times, the path and boundary constraints, the scalars, and the order of the times."""
    rows += len(problem.boundary) + len(problem.integrals)
    rows += int(problem.final_time[0] <= problem.initial_time[1])
    rows += sum(int(item.holds_at(path_points()).sum()) for item in problem.path)
    scalars = 2 + len(problem.design) + len(problem.integrals)
    return ProblemSize(variables + scalars, rows, nodes, 0.0)


def _timed(size: ProblemSize, dense: float) -> ProblemSize:
    """Seconds, from what the cases took: about 30 iterations, linear in the unknowns where sparse."""
    return ProblemSize(
        size.variables, size.constraints, size.nodes, 0.03 + 1e-4 * size.variables + 30 * dense
    )


def _sides(interval: Interval) -> int:
    return 1 if interval[0] == interval[1] else int(np.isfinite(interval).sum())


def _meet(first: Interval, second: Interval) -> Interval:
    return max(first[0], second[0]), min(first[1], second[1])
