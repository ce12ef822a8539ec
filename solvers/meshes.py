"""From the method of a document to its meshes: the only place that chooses a transcription."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from solvers.formulation.time_knots import mesh_corners
from solvers.mesh_points import gauss_mesh, interval_corners, interval_mesh, spline_mesh
from solvers.problem import OptimalControlProblem
from solvers.refine.adaptive import AdaptiveMesh
from solvers.refine.adaptive_gauss import GaussMesh
from solvers.refine.adaptive_intervals import IntervalMesh
from solvers.refine.adaptive_splines import SplineMesh
from solvers.spec import (
    GaussPseudospectralMethod,
    HermiteSimpsonMethod,
    Method,
    SplineAdaptivity,
    SplineWaveletMethod,
)
from solvers.start.guess import Start
from solvers.start.scaling import Scaling
from solvers.transcription.base import Transcription
from solvers.transcription.gauss_pseudospectral import GaussPseudospectral
from solvers.transcription.hermite_simpson import HermiteSimpson
from solvers.transcription.spline_wavelet import SplineWavelet

Mesh = Callable[[OptimalControlProblem, Scaling, Start], Transcription]
"""The problem on a mesh, from a start."""

# Levels between two solves of the continuation, the coarsest of them, and the level below which a mesh is
# solved directly: a start some levels coarser saves a third to two thirds of the iterations of a fine mesh,
# and costs as much as it saves on a coarse one.
_LEVEL_STRIDE = 3
_COARSEST_LEVEL = 1
_DIRECT_BELOW = 5


def meshes_of(method: Method) -> Sequence[Mesh]:
    """The meshes of a method from coarse to fine."""
    match method:
        case SplineWaveletMethod(L=length, first_level=finest):
            levels = [finest]
            if finest >= _DIRECT_BELOW:
                levels += range(finest - _LEVEL_STRIDE, _COARSEST_LEVEL - 1, -_LEVEL_STRIDE)
            return [_splines(length, level, adapts=method.adaptive is not None) for level in sorted(levels)]
        case GaussPseudospectralMethod(nodes=nodes, segments=segments):
            return [lambda p, s, start: GaussPseudospectral(p, s, start, *gauss_mesh(p, nodes, segments))]
        case HermiteSimpsonMethod(intervals=intervals):
            return [lambda p, s, start: HermiteSimpson(p, s, start, interval_mesh(p, intervals))]
    raise TypeError(f"no transcription for the method {method!r}")


def _splines(length: int, level: int, *, adapts: bool) -> Mesh:
    def mesh(problem: OptimalControlProblem, scaling: Scaling, start: Start) -> Transcription:
        knots = spline_mesh(problem, length, level)
        graded = knots.finest > level
        return SplineWavelet(problem, scaling, start, knots, adaptive=adapts or graded)

    return mesh


def adaptive_mesh_of(method: Method, problem: OptimalControlProblem) -> AdaptiveMesh:
    """The finest mesh of :func:`meshes_of`, as one that knows how to become a better one."""
    match method:
        case SplineWaveletMethod(L=length, first_level=level, adaptive=SplineAdaptivity(max_level=highest)):
            second_order = problem.dynamics.coordinates > 0
            return SplineMesh(spline_mesh(problem, length, level), highest, second_order)
        case GaussPseudospectralMethod(nodes=nodes, segments=segments):
            return GaussMesh(*gauss_mesh(problem, nodes, segments), mesh_corners(problem))
        case HermiteSimpsonMethod(intervals=intervals):
            return IntervalMesh(interval_mesh(problem, intervals), interval_corners(problem))
    raise TypeError(f"no adaptive mesh for the method {method!r}")
