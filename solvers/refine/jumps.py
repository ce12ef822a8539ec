"""Where a control on a mesh jumps from one of its bounds to the other, seen through the mesh."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solvers.bases.legendre import composite_gauss
from solvers.curves import Curve
from solvers.formulation.quantities import Interval
from solvers.problem import OptimalControlProblem
from solvers.switching import SHORTEST_INTERIOR, inside, is_switched
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

_POINTS = 3
# The part of where a jump is seen by polynomials of higher degree in which it lies.
_FIRST_MOMENT = 0.125
# An interval for a jump is this much shorter than it might be.
_SPARE = 1.4


@dataclass(frozen=True)
class Jump:
    """A jump at the normalised time ``place`` that the mesh smears over ``start`` to ``stop``.

    ``excess``: how many times too much it gives away.
    """

    place: float
    start: float
    stop: float
    excess: float = 0.0


def jumps_of(problem: OptimalControlProblem, trajectory: Trajectory) -> list[Jump]:
    """The jumps of all controls with two bounds, in order.

    A stretch inside the bounds, between nodes on different ones, is a jump if it has few nodes or is narrower
    than the widest interval. The jump is where it has the same integral as the stretch: what is left of the
    difference on a flight is its first moment, the square of the width.
    """
    found: list[Jump] = []
    for name, bounds in zip(problem.controls, problem.control_bounds, strict=True):
        if is_switched(bounds):
            found += _jumps(trajectory, trajectory.controls[name], bounds)
    return sorted(found, key=lambda jump: jump.place)


def first_moment(jump: Jump) -> float:
    """The width of the interval in which to look for a jump that polynomials of higher degree have seen."""
    return (jump.stop - jump.start) * _FIRST_MOMENT


def shorter(width: float, too_much: float) -> float:
    """The width of the interval around a jump after this ``width``, with which it gave ``too_much`` away.

    What is given away falls with the square of the width, to which the place is right too.
    """
    return max(width**2, width / (_SPARE * math.sqrt(too_much)))


def _jumps(trajectory: Trajectory, control: Curve, bounds: Interval) -> Iterator[Jump]:
    nodes = trajectory.nodes
    values = control(nodes)
    upper = values > 0.5 * (bounds[0] + bounds[1])
    resting = np.flatnonzero(~inside(values, bounds))
    widest = np.diff(trajectory.breakpoints).max()
    for before, after in pairwise(resting.tolist()):
        few = after - before <= SHORTEST_INTERIOR or nodes[after] - nodes[before] <= widest
        if upper[before] != upper[after] and few:
            # The nodes beside count as resting although they may be off by a little.
            start, stop = nodes[max(before - 1, 0)], nodes[min(after + 1, nodes.size - 1)]
            low, high = (bounds[0], bounds[1]) if upper[after] else (bounds[1], bounds[0])
            area = _integral(trajectory, control, bounds, start, stop)
            place = (high * stop - low * start - area) / (high - low)
            yield Jump(float(np.clip(place, start, stop)), float(start), float(stop))


def _integral(trajectory: Trajectory, control: Curve, bounds: Interval, start: float, stop: float) -> float:
    """The integral of the control, clipped to its bounds, between two normalised times."""
    breaks = trajectory.breakpoints
    between = breaks[(breaks > start) & (breaks < stop)]
    tau, weights = composite_gauss(np.concatenate([[start], between, [stop]]), _POINTS)
    return float(weights @ np.clip(control(tau), *bounds))
