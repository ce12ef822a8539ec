"""The adaptive mesh of the Gauss pseudospectral method: segments, and nodes on each (hp).

On a segment whose error is too large, the coefficients of the states in Legendre polynomials tell what
helps. Where they fall fast the solution is smooth, and each node more divides the error by the same factor:
as many are added as the decay promises to be enough. Where they do not, or there would be too many, the
segment is cut. Neighbours whose error is far below the target are joined. Where a control jumps from bound to
bound, polynomials pass both: a short segment of one node is laid around the jump, on which the control is a
constant.

Sources: M. A. Patterson, W. W. Hager, A. V. Rao, A ph mesh refinement method for optimal control, Optim.
Control Appl. Meth. 36, 2015, 398-421; F. Liu, W. W. Hager, A. V. Rao, Adaptive mesh refinement method for
optimal control using decay rates of Legendre polynomial coefficients, IEEE Trans. Control Syst. Technol. 26,
2018, 1475-1483.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from solvers.bases.legendre import legendre_gauss
from solvers.problem import OptimalControlProblem
from solvers.refine.adaptive import MeshLimit
from solvers.refine.adaptive_splines import largest_inside
from solvers.refine.jumps import Jump, first_moment, shorter
from solvers.start.guess import Start
from solvers.start.scaling import Scaling
from solvers.trajectory import Trajectory
from solvers.transcription.gauss_pseudospectral import GaussPseudospectral

Vector = NDArray[np.float64]

MAX_NODES = 8_192
"""The largest number of nodes of all segments together."""

_FEWEST_NODES = 6
_MOST_NODES = 24
_MOST_PIECES = 4
# Decades by which the coefficients must fall from degree to degree for a solution to count as smooth.
_SMOOTH = 0.25
_FLAT = 1e-3
_SHORTEST_SEGMENT = 1e-9


@dataclass(frozen=True)
class GaussMesh:
    """Segments between normalised ``breaks``, with ``counts`` nodes each; breaks at ``corners`` stay."""

    breaks: Vector
    counts: tuple[int, ...]
    corners: Vector = field(default_factory=lambda: np.zeros(0))

    def transcription(
        self, problem: OptimalControlProblem, scaling: Scaling, start: Start
    ) -> GaussPseudospectral:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        return GaussPseudospectral(problem, scaling, start, self.breaks, self.counts)

    @property
    def summary(self) -> dict[str, int]:
        """How many segments and nodes there are."""
        return {"segments": len(self.counts), "nodes": sum(self.counts)}

    @property
    def control_values(self) -> int:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        return sum(self.counts)

    def refined(
        self, trajectory: Trajectory, errors: Vector, target: float, jumps: Sequence[Jump] = ()
    ) -> GaussMesh:
        """See :class:`~solvers.refine.adaptive.AdaptiveMesh`."""
        worst = largest_inside(self.breaks, trajectory.breakpoints, errors)
        breaks, held, lost = self._placed(jumps, worst / target)
        pieces: list[_Piece] = []
        for is_lost, run in groupby(range(worst.size), self._touched(lost).__getitem__):
            segments = list(run)
            if is_lost:
                pieces += self._around(lost, segments[0], segments[-1])
                continue
            for index in segments:
                span = float(breaks[index]), float(breaks[index + 1])
                excess = 0.0 if index in held else float(worst[index]) / target
                pieces += _pieces(trajectory, span, self.counts[index], excess)
        ends, counts, _ = zip(*_joined(pieces, self.corners), strict=True)
        finer = replace(self, breaks=np.concatenate([[0.0], ends]), counts=counts)
        if sum(counts) > MAX_NODES:
            raise MeshLimit(f"more than {MAX_NODES:,} nodes would be needed")
        if np.min(np.diff(finer.breaks)) < _SHORTEST_SEGMENT:
            raise MeshLimit("segments would be shorter than a billionth of the horizon")
        return finer

    def _placed(self, jumps: Sequence[Jump], excess: Vector) -> tuple[Vector, set[int], list[Jump]]:
        """The breaks, the segments that hold a jump, and the jumps that none of one node holds as yet.

        Places of jumps may move with other errors: where these are good enough, segments around jumps are
        shortened, by moving their breaks.
        """
        breaks, held, lost = self.breaks.copy(), set(), []
        settled = np.all(excess[np.array(self.counts) > 1] <= 1.0)
        for jump in jumps:
            owner = min(int(np.searchsorted(self.breaks[1:], jump.place)), excess.size - 1)
            if self.counts[owner] > 1:
                if jump.excess > 1.0 or excess[self._touched([jump])].max() > 1.0:
                    lost.append(jump)
                continue
            held.add(owner)
            too_much = max(jump.excess, float(excess[owner]))
            if settled and too_much > 1.0:
                width = float(self.breaks[owner + 1] - self.breaks[owner])
                half = 0.5 * shorter(width, too_much)
                breaks[[owner, owner + 1]] = jump.place - half, jump.place + half
        return breaks, held, lost

    def _touched(self, jumps: Sequence[Jump]) -> NDArray[np.bool_]:
        """Which segments lie where one of these jumps is seen."""
        found = np.zeros(len(self.counts), bool)
        for jump in jumps:
            found |= (self.breaks[1:] > jump.start) & (self.breaks[:-1] < jump.stop)
        return found

    def _around(self, jumps: Sequence[Jump], first: int, last: int) -> list[_Piece]:
        """What becomes of segments on which jumps are seen: one of one node for each jump, others beside.

        One node is a control that is constant: it cannot pass its bounds, and moves a flight as a jump does.
        """
        halves = [(jump, 0.5 * first_moment(jump)) for jump in jumps]
        moments = [(jump.place - half, jump.place + half) for jump, half in halves]
        start, *inner, stop = self.breaks[first : last + 2].tolist()
        kept = [
            edge
            for edge in inner
            if edge in self.corners or not any(jump.start < edge < jump.stop for jump in jumps)
        ]
        cuts = [edge for moment in moments for edge in moment if start < edge < stop]
        beside = int(np.clip(max(self.counts[first : last + 1]), _FEWEST_NODES, _MOST_NODES // 2))
        return [
            (end, 1 if any(left < end <= right for left, right in moments) else beside, False)
            for end in sorted({*kept, *cuts, stop})
        ]


_Piece = tuple[float, int, bool]
"""Where a segment ends, its nodes, and whether its error is negligible."""


def _pieces(trajectory: Trajectory, span: tuple[float, float], count: int, excess: float) -> list[_Piece]:
    """What becomes of a segment whose error is ``excess`` times the target."""
    start, stop = span
    if excess <= 1.0:
        return [(stop, count, count > 1 and excess < _FLAT)]
    decay = _decay(trajectory, start, stop, count)
    decades = np.log10(excess) + 0.3
    if decay >= _SMOOTH and np.isfinite(decades):
        wanted = count + max(1, int(np.ceil(decades / decay)))
        if wanted <= _MOST_NODES:
            return [(stop, wanted, False)]
    # Halving h on K nodes divides the error by about 2^K: cut more often where that is not enough.
    number = 2 if np.isfinite(decades) and decades < 0.3 * count else _MOST_PIECES
    nodes = int(np.clip(count, _FEWEST_NODES, _MOST_NODES // 2))
    return [(end, nodes, False) for end in start + (stop - start) * np.arange(1, number + 1) / number]


def _joined(pieces: list[_Piece], corners: Vector) -> Iterator[_Piece]:
    """Pairs of neighbouring segments whose errors are negligible become one, with the nodes of the richer.

    A corner of the model between them keeps them apart.
    """
    pending: _Piece | None = None
    for piece in pieces:
        if pending is not None and pending[2] and piece[2] and pending[0] not in corners:
            yield piece[0], max(pending[1], piece[1]), True
            pending = None
            continue
        if pending is not None:
            yield pending
        pending = piece
    if pending is not None:
        yield pending


def _decay(trajectory: Trajectory, start: float, stop: float, count: int) -> float:
    """Decades from degree to degree by which the Legendre coefficients of the states fall on a segment.

    The slope of a line through the logarithms of the upper half of the coefficients, the largest at each
    degree over the states in their scales.
    """
    points, weights = legendre_gauss(count + 1)
    tau = start + (stop - start) * (points + 1.0) / 2.0
    values = trajectory.states_at(tau)
    scale = np.maximum(1e-6, np.abs(trajectory.states_at(trajectory.nodes)).max(axis=1))
    degrees = np.arange(count + 1)
    coefficients = (values / scale[:, None] * weights) @ legvander(points, count) * (degrees + 0.5)
    size = np.log10(np.maximum(np.abs(coefficients).max(axis=0), 1e-16))
    upper = degrees >= min(count // 2, count - 2)
    return float(-np.polyfit(degrees[upper], size[upper], 1)[0]) if np.count_nonzero(upper) > 1 else 0.0
