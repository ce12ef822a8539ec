"""Where segments begin and end, how far their predictions see, and what the actuators can."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from solvers.piecewise.mesh import Mesh
from solvers.problem import OptimalControlProblem
from solvers.spec import PiecewiseMethod, bound_interval

Vector = NDArray[np.float64]

# A last segment shorter than this part of the others is no segment.
_SHORTEST = 1e-9
# What comes after the segment only guides it: there intervals are twice as long, and no more than so many.
_COARSER, _MOST_AHEAD = 2, 60


@dataclass(frozen=True)
class Plan:
    """Segments between ``edges`` (N + 1,): of time, or of the state ``state`` where that is not None.

    ``sees``: how many segments a prediction sees, its own among them.
    """

    edges: Vector
    state: int | None
    sees: int
    nodes: int

    @classmethod
    def of(cls, method: PiecewiseMethod, problem: OptimalControlProblem) -> Plan:
        """The plan of a document."""
        segments = method.segments
        if segments.by == "time":
            assert segments.length is not None
            start, end = problem.initial_time[0], problem.final_time[1]
            count = max(1, ceil((end - start) / segments.length - _SHORTEST))
            edges = np.append(start + segments.length * np.arange(count), end)
            state = None
        else:
            assert segments.count is not None
            state = problem.states.index(segments.by)
            edges = np.linspace(
                problem.initial_state[state][0], problem.final_state[state][0], segments.count + 1
            )
        sees = edges.size - 1 if method.lookahead == "end" else int(method.lookahead)
        return cls(edges, state, 1 if method.scheme == "chapter" else sees, method.nodes)

    @property
    def count(self) -> int:
        """The number of segments."""
        return int(self.edges.size) - 1

    def last_seen(self, index: int) -> int:
        """The index of the last segment that the prediction of segment ``index`` sees."""
        return min(index + self.sees, self.count) - 1

    def mesh(self, index: int) -> Mesh:
        """The mesh of the prediction of a segment: soft on its first half, without a rest everywhere."""
        if self.last_seen(index) == index:
            return Mesh(self.nodes, 0, 0).softened()
        rest = min(ceil(self.nodes * (self.sees - 1) / _COARSER), _MOST_AHEAD)
        return Mesh(self.nodes, rest, self.nodes)

    def sees_the_end(self, index: int) -> bool:
        """Whether the horizon of segment ``index`` ends where the problem ends."""
        return self.last_seen(index) == self.count - 1


def actuator_limits(problem: OptimalControlProblem, method: PiecewiseMethod) -> Vector:
    """Lower and upper limits of every control, (m, 2): those of the tracking, else the problem's bounds."""
    given = method.tracking.limits
    rows = [
        bound_interval(given[name], problem.parameters) if name in given else bounds
        for name, bounds in zip(problem.controls, problem.control_bounds, strict=True)
    ]
    return np.array(rows, np.float64).reshape(-1, 2)
