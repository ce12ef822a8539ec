"""The adaptive mesh of Hermite-Simpson collocation: intervals cut where the error is too large.

The residual of a cubic leaves an error of the fifth order in the step, so that the number of pieces that an
interval needs follows from its error; equal neighbours whose error is far below the target are joined.

Source: J. T. Betts, Practical Methods for Optimal Control and Estimation Using Nonlinear Programming, 2nd
ed., SIAM 2010, section 4.7 (error from the integral of the residual; at most so many pieces at once).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solvers.formulation.time_knots import LONGEST_MOMENT
from solvers.problem import OptimalControlProblem
from solvers.refine.adaptive import MeshLimit
from solvers.refine.adaptive_splines import largest_inside
from solvers.refine.jumps import Jump, first_moment, shorter
from solvers.start.guess import Start
from solvers.start.scaling import Scaling
from solvers.trajectory import Trajectory
from solvers.transcription.hermite_simpson import HermiteSimpson

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]

MAX_INTERVALS = 10_000
"""Both the ends and the middles of the intervals are nodes, of which 20,000 may be active."""

_ORDER = 5.0
_SAFE = 0.7
_MOST_PIECES = 5
_JOIN = 2.0**-8
_SHORTEST_INTERVAL = 1e-9
# Beside the interval of a jump others are as if that were so many times as wide.
_BESIDE_JUMP = 16.0
# So many jumps one after the other, all within this part of the horizon, are one singular arc.
_CHATTER, _SHORT = 4, 0.1


@dataclass(frozen=True)
class IntervalMesh:
    """Intervals between normalised ``knots``, of which those at ``corners`` of the model stay.

    ``jumps``: the indices of intervals that are there for a jump of a control.
    """

    knots: Vector
    corners: Vector = field(default_factory=lambda: np.zeros(0))
    jumps: tuple[int, ...] = ()

    def transcription(self, problem: OptimalControlProblem, scaling: Scaling, start: Start) -> HermiteSimpson:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        return HermiteSimpson(problem, scaling, start, self.knots, within=True)

    @property
    def summary(self) -> dict[str, int]:
        """How many intervals there are."""
        return {"intervals": self.knots.size - 1}

    @property
    def control_values(self) -> int:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        return 2 * self.knots.size - 1

    def refined(
        self, trajectory: Trajectory, errors: Vector, target: float, jumps: Sequence[Jump] = ()
    ) -> IntervalMesh:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        worst = largest_inside(self.knots, trajectory.breakpoints, errors)
        chatter = _chatter(jumps)
        if chatter is not None:
            where = trajectory.time(np.array([chatter.place]))[0]
            raise MeshLimit(f"a control chatters between its bounds at t = {where:.6g}")
        mesh, excess = self._with_jumps(jumps, worst / target)
        widths, fixed = np.diff(mesh.knots), mesh._for_jumps
        number = np.ceil((excess / _SAFE) ** (1.0 / _ORDER))
        pieces = np.where(excess > 1.0, np.clip(number, 2, _MOST_PIECES), 1).astype(np.int64)
        # A piece next to a much wider one would see it as a jump: let widths grow by a factor 4 at most.
        while True:
            # An interval that is there for a jump says little about its neighbours.
            free = ~fixed & (widths >= LONGEST_MOMENT)
            step = np.where(free, widths / pieces, np.where(fixed, _BESIDE_JUMP * widths, np.inf))
            beside = np.minimum(np.append(step[1:], np.inf), np.append(np.inf, step[:-1]))
            uneven = free & (step > 4.0 * beside * (1.0 + 1e-9))
            if not uneven.any():
                break
            pieces = pieces + uneven
        cuts = [
            start + width * np.arange(count) / count
            for start, width, count in zip(mesh.knots[:-1], widths, pieces, strict=True)
        ]
        knots = np.append(np.concatenate(cuts), 1.0)
        keep = np.ones(knots.size, bool)
        starts = np.cumsum(pieces) - pieces
        keep[starts[_superfluous(widths, (excess < _JOIN) & ~fixed)]] = False
        keep |= np.isin(knots, self.corners)
        finer = mesh._on(knots[keep])
        if finer.knots.size > MAX_INTERVALS + 1:
            raise MeshLimit(f"more than {MAX_INTERVALS:,} intervals would be needed")
        if np.min(np.diff(finer.knots)) < _SHORTEST_INTERVAL:
            raise MeshLimit("intervals would be shorter than a billionth of the horizon")
        return finer

    @property
    def _for_jumps(self) -> Flags:
        """Which intervals are there for a jump."""
        return np.isin(np.arange(self.knots.size - 1), self.jumps)

    def _with_jumps(self, jumps: Sequence[Jump], excess: Vector) -> tuple[IntervalMesh, Vector]:
        """The mesh with an interval for each jump, and how far the others are off, in units of the target.

        Places of jumps may move with other errors: where these are good enough, the intervals of jumps are
        shortened, by moving their knots. A jump that none holds as yet gets one, and the intervals through
        which it is seen wait for the next answer.
        """
        knots, excess, lost = self.knots.copy(), excess.copy(), []
        settled = bool(np.all(excess[~self._for_jumps] <= 1.0))
        for jump in jumps:
            owner = min(int(np.searchsorted(self.knots[1:], jump.place)), excess.size - 1)
            if owner not in self.jumps:
                seen = (self.knots[1:] > jump.start) & (self.knots[:-1] < jump.stop)
                if jump.excess > 1.0 or excess[seen].max() > 1.0:
                    lost.append(jump)
                continue
            too_much, excess[owner] = max(jump.excess, float(excess[owner])), 0.0
            if settled and too_much > 1.0:
                width = float(self.knots[owner + 1] - self.knots[owner])
                knots[[owner, owner + 1]] = _around(jump, shorter(width, too_much))
        mesh = replace(self, knots=knots)
        for jump in lost:
            mesh, excess = mesh._holding(jump, excess)
        return mesh, excess

    def _holding(self, jump: Jump, excess: Vector) -> tuple[IntervalMesh, Vector]:
        """The mesh with an interval for a jump in the place of those through which it is seen."""
        ends = np.clip(_around(jump, first_moment(jump)), 0.0, 1.0)
        between = np.abs(self.knots - jump.place) < first_moment(jump)
        mesh = self._on(np.union1d(self.knots[~between | np.isin(self.knots, self.corners)], ends))
        middles = (mesh.knots[1:] + mesh.knots[:-1]) / 2.0
        seen = (mesh.knots[1:] > jump.start) & (mesh.knots[:-1] < jump.stop)
        excess = np.where(seen, 0.0, excess[np.searchsorted(self.knots, middles) - 1])
        held = np.flatnonzero((middles > ends[0]) & (middles < ends[1]))
        return replace(mesh, jumps=(*mesh.jumps, *held.tolist())), excess

    def _on(self, knots: Vector) -> IntervalMesh:
        """The mesh on other knots, with those of the intervals for jumps that are still the same."""
        places = [(int(np.searchsorted(knots, self.knots[i])), self.knots[i : i + 2]) for i in self.jumps]
        kept = [i for i, ends in places if np.array_equal(knots[i : i + 2], ends)]
        return replace(self, knots=knots, jumps=tuple(kept))


def _chatter(jumps: Sequence[Jump]) -> Jump | None:
    """The first of a chain of jumps that are seen through each other's intervals; None if there is none."""
    chain = list[Jump]()
    for jump in jumps:
        chain = [*chain, jump] if chain and jump.start <= chain[-1].stop else [jump]
        if len(chain) == _CHATTER and jump.stop - chain[0].start < _SHORT:
            return chain[0]
    return None


def _around(jump: Jump, width: float) -> Vector:
    return jump.place + 0.5 * width * np.array([-1.0, 1.0])


def _superfluous(widths: Vector, quiet: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Indices of intervals to be joined to their left neighbour: both quiet, alike in width, in pairs."""
    found: list[int] = []
    for index in range(1, widths.size):
        equal = 0.5 <= widths[index] / widths[index - 1] <= 2.0
        if quiet[index] and quiet[index - 1] and equal and (not found or found[-1] < index - 1):
            found.append(index)
    return np.array(found, np.intp)
