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

from solvers.guess import Start
from solvers.problem import OptimalControlProblem
from solvers.refine.adaptive import MeshLimit
from solvers.refine.adaptive_splines import largest_inside
from solvers.refine.jumps import Jump
from solvers.scaling import Scaling
from solvers.time_knots import LONGEST_MOMENT
from solvers.trajectory import Trajectory
from solvers.transcription.hermite_simpson import HermiteSimpson

Vector = NDArray[np.float64]

MAX_INTERVALS = 10_000
"""Both the ends and the middles of the intervals are nodes, of which 20,000 may be active."""

_ORDER = 5.0
_SAFE = 0.7
_MOST_PIECES = 5
_JOIN = 2.0**-8
# A stretch between two bounds is a jump if it is shorter than this part of the horizon. Parabolas pass bounds
# there, by up to an eighth of the range.
_FIRM = 0.02
_OVERSHOOT = 1e-3
_SHORTEST_INTERVAL = 1e-9


@dataclass(frozen=True)
class IntervalMesh:
    """Intervals between normalised ``knots``, of which those at ``corners`` of the model stay."""

    knots: Vector
    corners: Vector = field(default_factory=lambda: np.zeros(0))

    def transcription(self, problem: OptimalControlProblem, scaling: Scaling, start: Start) -> HermiteSimpson:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        return HermiteSimpson(problem, scaling, start, self.knots)

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
        for jump in jumps:
            seen = (self.knots[1:] > jump.start) & (self.knots[:-1] < jump.stop)
            if jump.stop - jump.start < _FIRM and worst[seen].max() > max(target, _OVERSHOOT):
                where = trajectory.time(np.array([jump.place]))[0]
                raise MeshLimit(
                    f"a control jumps at t = {where:.6g}, where parabolas pass its bounds on any mesh"
                )
        number = np.ceil((worst / (_SAFE * target)) ** (1.0 / _ORDER))
        pieces = np.where(worst > target, np.clip(number, 2, _MOST_PIECES), 1).astype(np.int64)
        widths = np.diff(self.knots)
        # A piece next to a much wider one would see it as a jump: let widths grow by a factor 4 at most.
        while True:
            # An interval that is there for a jump of the model says nothing about its neighbours.
            step = np.where(widths < LONGEST_MOMENT, np.inf, widths / pieces)
            beside = np.minimum(np.append(step[1:], np.inf), np.append(np.inf, step[:-1]))
            uneven = np.isfinite(step) & (step > 4.0 * beside * (1.0 + 1e-9))
            if not uneven.any():
                break
            pieces = pieces + uneven
        cuts = [
            start + width * np.arange(count) / count
            for start, width, count in zip(self.knots[:-1], widths, pieces, strict=True)
        ]
        knots = np.append(np.concatenate(cuts), 1.0)
        keep = np.ones(knots.size, bool)
        starts = np.cumsum(pieces) - pieces
        keep[starts[_superfluous(widths, worst < _JOIN * target)]] = False
        keep |= np.isin(knots, self.corners)
        knots = knots[keep]
        if knots.size > MAX_INTERVALS + 1:
            raise MeshLimit(f"more than {MAX_INTERVALS:,} intervals would be needed")
        if np.min(np.diff(knots)) < _SHORTEST_INTERVAL:
            raise MeshLimit("intervals would be shorter than a billionth of the horizon")
        return replace(self, knots=knots)


def _superfluous(widths: Vector, quiet: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Indices of intervals to be joined to their left neighbour: both quiet, alike in width, in pairs."""
    found: list[int] = []
    for index in range(1, widths.size):
        equal = 0.5 <= widths[index] / widths[index - 1] <= 2.0
        if quiet[index] and quiet[index - 1] and equal and (not found or found[-1] < index - 1):
            found.append(index)
    return np.array(found, np.intp)
