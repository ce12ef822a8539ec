"""Segments and nodes for the arcs of a structure: a first guess from the model, then hp steps from errors.

Where the Legendre coefficients of a segment fall fast, a higher degree reaches the tolerance, else the
segment is halved: Liu, Hager, Rao, "Adaptive mesh refinement method for optimal control using decay rates of
Legendre polynomial coefficients", IEEE Trans. Control Syst. Technol. 26(4), 2018.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solvers.backends import NUMPY
from solvers.bases.legendre import gauss_support
from solvers.problem import OptimalControlProblem
from solvers.refine.structure import Structure
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

MOST_NODES = 40
"""The most nodes of a segment."""

# A control that no bound and no limit decides hardly matters where it is singular, and goes far astray where
# its nodes are few.
_FEWEST_NODES, _FEWEST_UNDECIDED = 8, 12
# The most nodes of a segment of the first mesh: the blocks of longer ones cost more than another segment.
_FIRST_NODES = 20
# Numbers of nodes are multiples of this: problems that differ a little get the same mesh.
_STEP = 2
_MOST_SEGMENTS = 24
# What the first mesh aims at, relative, for a motion that is faster than the linearised model's by the first
# factor, by the second where a control is free.
_AIM = 1e-7
_HARMONICS = 1.5, 2.0
_SAMPLES_PER_ARC = 5
# Digits a node below which a higher degree is no use, and nodes that are added to what the decay asks for.
_SLOW_DECAY = 0.12
_SPARE_NODES = 2


@dataclass(frozen=True)
class ArcMesh:
    """For each arc the ends of its segments as ``parts`` of it, from 0 to 1, and their numbers of nodes."""

    parts: tuple[tuple[float, ...], ...]
    counts: tuple[tuple[int, ...], ...]

    @property
    def flat_counts(self) -> tuple[int, ...]:
        """Numbers of nodes, segment by segment."""
        return tuple(count for counts in self.counts for count in counts)

    def breaks(self, edges: Vector) -> Vector:
        """The ends of all segments, normalised, for arcs between ``edges``."""
        starts = [
            start + (stop - start) * np.array(parts[:-1])
            for (start, stop), parts in zip(pairwise(edges), self.parts, strict=True)
        ]
        return np.concatenate([*starts, [1.0]])

    def refined(self, trajectory: Trajectory, errors: Vector, tolerance: float) -> ArcMesh:
        """More nodes, or halves, for the segments whose error is above the tolerance."""
        parts, counts, segment = [], [], 0
        for arc_parts, arc_counts in zip(self.parts, self.counts, strict=True):
            new_parts, new_counts = [0.0], list[int]()
            for (start, stop), count in zip(pairwise(arc_parts), arc_counts, strict=True):
                wanted = count
                if errors[segment] > tolerance:
                    wanted = _wanted_nodes(trajectory, segment, count, errors[segment] / tolerance)
                if wanted <= MOST_NODES:
                    new_parts.append(stop)
                    new_counts.append(wanted)
                else:
                    half = max(_FEWEST_NODES, _even(0.6 * count))
                    new_parts += [0.5 * (start + stop), stop]
                    new_counts += [half, half]
                segment += 1
            parts.append(tuple(new_parts))
            counts.append(tuple(new_counts))
        return ArcMesh(tuple(parts), tuple(counts))


def first_mesh(problem: OptimalControlProblem, trajectory: Trajectory, structure: Structure) -> ArcMesh:
    """Nodes enough for the fastest motion of the linearised model along each arc.

    exp(lambda t) on an arc of length T needs K nodes with (e z / 2K)^K small, z = |lambda| T / 2.
    """
    lengths = np.diff(structure.edges)
    fractions = (np.arange(_SAMPLES_PER_ARC) + 0.5) / _SAMPLES_PER_ARC
    tau = structure.edges[:-1, None] + lengths[:, None] * fractions
    fastest = _fastest_motions(problem, trajectory, tau.ravel()).reshape(tau.shape).max(axis=1)
    free = np.isnan([*structure.pinned.values()]).any(axis=0)
    reaches = 0.5 * fastest * lengths * trajectory.duration * np.where(free, _HARMONICS[1], _HARMONICS[0])
    parts, counts = [], []
    fewest = np.where(structure.decided_arcs, _FEWEST_NODES, _FEWEST_UNDECIDED)
    for reach, least in zip(reaches, fewest.tolist(), strict=True):
        segments = 1
        while (count := _nodes_for(reach / segments)) > _FIRST_NODES and segments < _MOST_SEGMENTS:
            segments += 1
        parts.append(tuple(np.linspace(0.0, 1.0, segments + 1).tolist()))
        counts.append((min(max(count, least), MOST_NODES),) * segments)
    return ArcMesh(tuple(parts), tuple(counts))


def _fastest_motions(problem: OptimalControlProblem, trajectory: Trajectory, tau: Vector) -> Vector:
    """The largest magnitude of an eigenvalue of df/dx at each instant, 0 where the model is not finite."""
    x, u, t = trajectory.states_at(tau), trajectory.controls_at(tau), trajectory.time(tau)
    n, count = x.shape
    step = 1e-6 * np.maximum(1e-3, np.abs(x).max(axis=1))
    # All offsets side by side: state i moved up and down at every instant.
    offsets = np.repeat(np.hstack([np.diag(step), -np.diag(step)]), count, axis=1)
    scope = np.tile(x, 2 * n) + offsets, np.tile(u, 2 * n), np.tile(t, 2 * n)
    with np.errstate(all="ignore"):
        rates = problem.rate(*scope, problem.parameters_of(trajectory), NUMPY)
        moved = np.array(np.broadcast_arrays(*rates, scope[2])[:-1]).reshape(n, 2, n, count)
        jacobians = np.moveaxis((moved[:, 0] - moved[:, 1]) / (2.0 * step[:, None]), -1, 0)
    finite = np.isfinite(jacobians).all(axis=(1, 2))
    fastest = np.zeros(count)
    fastest[finite] = np.abs(np.linalg.eigvals(jacobians[finite])).max(axis=1)
    return fastest


def _nodes_for(reach: float) -> int:
    count = np.arange(_FEWEST_NODES, 2 * MOST_NODES)
    logarithm = count * np.log(np.maximum(np.e * reach / (2.0 * count), np.finfo(float).tiny))
    enough = np.flatnonzero(logarithm <= np.log(_AIM))
    return _even(float(count[enough[0]])) if enough.size else int(count[-1])


def _wanted_nodes(trajectory: Trajectory, segment: int, count: int, excess: float) -> int:
    """The nodes that bring the error down by ``excess``, after their decay; too many if slow."""
    decay = _decay(trajectory, segment, count)
    if decay < _SLOW_DECAY:
        return MOST_NODES + 1
    return _even(count + np.log10(excess) / decay + _SPARE_NODES)


def _decay(trajectory: Trajectory, segment: int, count: int) -> float:
    """Digits that the Legendre coefficients of the states lose from one degree to the next."""
    start, stop = np.array(trajectory.basis["breaks"])[segment : segment + 2]
    points = gauss_support(count)
    tau = start + (stop - start) * (points + 1.0) / 2.0
    coefficients = np.linalg.solve(
        np.polynomial.legendre.legvander(points, count), trajectory.states_at(tau).T
    )
    scale = np.maximum(np.abs(coefficients).max(axis=0), np.finfo(float).tiny)
    sizes = np.maximum(np.abs(coefficients / scale).max(axis=1), 1e-15)
    # Odd and even degrees may vanish in turn: what counts is the largest from here on.
    envelope = np.log10(np.maximum.accumulate(sizes[::-1])[::-1])
    degrees = np.arange(count + 1)
    upper = degrees >= count // 2
    return float(-np.polyfit(degrees[upper], envelope[upper], 1)[0])


def _even(count: float) -> int:
    return int(_STEP * np.ceil(count / _STEP))
