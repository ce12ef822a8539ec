"""The adaptive mesh of the spline wavelet method: graded dyadic knots, whose splits are the active wavelets.

A wavelet becomes active where the residual of the dynamics is too large, and is dropped where that would stay
far below the target without it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solvers.bases.graded import GradedKnots
from solvers.problem import OptimalControlProblem
from solvers.refine.adaptive import MeshLimit
from solvers.refine.jumps import Jump
from solvers.spec.method_model import HIGHEST_LEVEL
from solvers.start.guess import Start
from solvers.start.scaling import Scaling
from solvers.trajectory import Trajectory
from solvers.transcription.spline_wavelet import SplineWavelet

Vector = NDArray[np.float64]

MAX_ACTIVE = 20_000
"""The largest number of active functions of a variable."""

# The error inside a patch of equal intervals falls with this power of the step, beside a change of level and
# at the ends with the second: the rule of quadrature behind the costates is of first order there.
_INNER_ORDER = 3.0
_EDGE_ORDER = 2.0
_MOST_LEVELS_AT_ONCE = 2
# Models of second order obey their equations in the mean: the order holds at changes of level too, where the
# error is about twice that inside.
_MOST_LEVELS_IN_THE_MEAN = 3
_AIM_IN_THE_MEAN = 0.4
# An interval this close to the target is refined with the bad ones, which aim this far below it.
_CLOSE = 0.7
_AIM = 0.8
# The error at a change of level dies away within so many intervals.
_REACH = 8
# A bad interval makes its neighbours bad by about this part.
_BESIDE = 0.5
# Siblings are joined where the error would stay this much below the target, while the mesh is far from done.
_JOIN = 2.0**-7
_FAR_FROM_DONE = 30.0


@dataclass(frozen=True)
class SplineMesh:
    """Knots of levels up to ``max_level``; ``second_order``: of a model that is."""

    knots: GradedKnots
    max_level: int
    second_order: bool = False

    def transcription(self, problem: OptimalControlProblem, scaling: Scaling, start: Start) -> SplineWavelet:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        return SplineWavelet(problem, scaling, start, self.knots, adaptive=True)

    @property
    def summary(self) -> dict[str, int | float]:
        """``levels`` J, ``active`` functions, ``full`` = 2^J L + 3, ``compression`` = active / full."""
        knots = self.knots
        return {
            "levels": knots.finest,
            "active": knots.dimension,
            "full": knots.full,
            "compression": knots.dimension / knots.full,
        }

    @property
    def control_values(self) -> int:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        return self.knots.intervals + (1 if self.second_order else 2)

    def refined(
        self, trajectory: Trajectory, errors: Vector, target: float, jumps: Sequence[Jump] = ()
    ) -> SplineMesh:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        levels = self.knots.levels
        worst = largest_inside(self.knots.knots, trajectory.breakpoints, errors)
        stuck = (worst > target) & (levels >= self.max_level)
        if stuck.any():
            # What cannot be bettered need not be bettered elsewhere either.
            target = max(target, float(worst[stuck].max()))
        at_jumps = {jump.place: self._level_for(jump) for jump in jumps}
        helped = (worst > target) & (levels < self.max_level)
        if not helped.any() and all(level <= self._level_at(place) for place, level in at_jumps.items()):
            where = _time_of_worst(trajectory, errors)
            way = "a higher one" if self.max_level < HIGHEST_LEVEL else "a larger L"
            raise MeshLimit(f"max_level = {self.max_level} is reached at {where}; {way} makes finer knots")
        wanted = np.clip(levels + self._change(worst, target), 0, self.max_level)
        finer = self.knots.adapted(wanted)
        for place, level in at_jumps.items():
            finer = finer.towards(place, level)
        if finer.dimension > MAX_ACTIVE:
            raise MeshLimit(f"more than {MAX_ACTIVE:,} active functions would be needed")
        return replace(self, knots=finer)

    def _change(self, worst: Vector, target: float) -> NDArray[np.int64]:
        """By how many levels each interval is split or joined, from its error."""
        bad = worst > target
        if self.second_order and not bad.any():
            return np.zeros(worst.size, np.int64)
        # A neighbour of a bad interval becomes the next bad one: take it along.
        beside = np.maximum(np.append(worst[1:], 0.0), np.append(0.0, worst[:-1]))
        size = np.maximum(worst, _BESIDE * beside)
        aim, close, most = _AIM, _CLOSE, _MOST_LEVELS_AT_ONCE
        if self.second_order:
            aim, close, most = _AIM_IN_THE_MEAN, _AIM_IN_THE_MEAN, _MOST_LEVELS_IN_THE_MEAN
        with np.errstate(divide="ignore"):
            deeper = np.ceil(np.log2(size / (aim * target)) / self._order)
        change = np.where(size > close * target, np.clip(deeper, 1, most), 0)
        if worst.max() > _FAR_FROM_DONE * target:
            change = np.where(size < _JOIN * target, -1, change)
        if not self.second_order and not bad[~_widened(self._steps)].any():
            change = self._evened(bad)
        return change

    def _level_at(self, place: float) -> int:
        knots = self.knots
        return int(knots.levels[min(int(np.searchsorted(knots.knots[1:], place)), knots.intervals - 1)])

    def _level_for(self, jump: Jump) -> int:
        """How fine the mesh must be at a jump, as far as this one tells where that is.

        What is given away falls with the square of the width, and so does the error of the place.
        """
        level = self._level_at(jump.place)
        if jump.excess <= 1.0:
            return level
        wanted = level + math.ceil(math.log2(jump.excess) / 2.0)
        return min(wanted, 2 * level + int(math.log2(self.knots.L)), self.max_level)

    @property
    def _steps(self) -> NDArray[np.bool_]:
        """Whether the level changes from one interval to the next."""
        return np.asarray(np.diff(self.knots.levels) != 0)

    @property
    def _order(self) -> Vector:
        edge = (np.append(True, self._steps) | np.append(self._steps, True)) & (not self.second_order)
        return np.where(edge, _EDGE_ORDER, _INNER_ORDER)

    def _evened(self, bad: NDArray[np.bool_]) -> NDArray[np.int64]:
        """The change where the error is too large beside changes of level only: the coarser patch by one.

        To refine the bad intervals would but move the change of level, with its error, along the patch.
        """
        levels = self.knots.levels
        patch = np.append(0, np.cumsum(self._steps))
        steps = np.flatnonzero(self._steps & _widened(bad)[1:-1])
        coarser = np.where(levels[steps] < levels[steps + 1], steps, steps + 1)
        return np.isin(patch, patch[coarser]).astype(np.int64)


def _widened(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Flags of M + 1 items, each between two of M: where one of its neighbours within _REACH is set."""
    near = np.convolve(flags, np.ones(2 * _REACH), "full")
    return np.asarray(near[_REACH - 1 : near.size - _REACH + 1] > 0.0)


def largest_inside(knots: Vector, breaks: Vector, errors: Vector) -> Vector:
    """For each interval between ``knots`` the largest of the errors between the ``breaks`` inside."""
    owner = np.searchsorted(knots, (breaks[1:] + breaks[:-1]) / 2.0) - 1
    largest = np.zeros(knots.size - 1)
    np.maximum.at(largest, owner, errors)
    return largest


def _time_of_worst(trajectory: Trajectory, errors: Vector) -> str:
    start = trajectory.breakpoints[[int(np.argmax(errors))]]
    return f"t = {trajectory.time(start)[0]:.6g}"
