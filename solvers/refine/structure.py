"""The structure of an answer: which control rests on which bound, and when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.problem import OptimalControlProblem
from solvers.report import constraint_margins
from solvers.switching import find_switching
from solvers.trajectory import Trajectory

Vector = NDArray[np.float64]

# Instants closer than this part of the horizon are one instant.
SHORTEST_ARC = 1e-5
# A constraint that is active for less than this part of the horizon is touched, not followed.
_TOUCH = 0.02


@dataclass(frozen=True)
class Structure:
    """S arcs between normalised ``breaks`` (S + 1); ``pinned``: for each control S values, NaN where free."""

    breaks: Vector
    pinned: Mapping[str, Vector]

    @property
    def arcs(self) -> int:
        """The number S of arcs."""
        return self.breaks.size - 1

    def without_empty_arcs(self) -> Structure:
        """Arcs of no length dropped, neighbours that are alike joined."""
        keep = [arc for arc in range(self.arcs) if self.breaks[arc + 1] - self.breaks[arc] > SHORTEST_ARC]
        starts: list[int] = []
        for arc in keep:
            if not starts or not self._alike(starts[-1], arc):
                starts.append(arc)
        inner = self.breaks[starts[1:]]
        return Structure(
            np.concatenate([[0.0], inner, [1.0]]),
            {name: values[starts] for name, values in self.pinned.items()},
        )

    def split(self, name: str, arc: int, instants: Vector, levels: Vector) -> Structure:
        """Arc number ``arc`` cut at ``instants``; along the pieces the control ``name`` rests on ``levels``."""
        pieces = instants.size + 1
        repeated = {
            other: np.insert(values, arc, np.full(pieces - 1, values[arc]))
            for other, values in self.pinned.items()
        }
        repeated[name][arc : arc + pieces] = levels
        return Structure(np.insert(self.breaks, arc + 1, instants), repeated)

    def _alike(self, first: int, second: int) -> bool:
        # Free arcs stay apart: between them a constraint becomes active or lets go.
        return all(values[first] == values[second] for values in self.pinned.values())


def find_structure(problem: OptimalControlProblem, trajectory: Trajectory) -> Structure:
    """Read arcs off a first answer: from its controls, and from constraints that it follows."""
    switching = find_switching(problem, trajectory)
    instants = [trajectory.tau(np.array(found["times"])) for found in switching.values()]
    instants += [_followed(problem, trajectory)]
    breaks = _distinct(np.concatenate([*instants, np.zeros(0)]))
    middles = (breaks[1:] + breaks[:-1]) / 2.0
    pinned = {}
    for name in problem.controls:
        levels = np.array([np.nan])
        edges = np.zeros(0)
        if name in switching:
            levels = np.array([np.nan if level is None else level for level in switching[name]["levels"]])
            edges = trajectory.tau(np.array(switching[name]["times"]))
        pinned[name] = levels[np.searchsorted(edges, middles)]
    return Structure(breaks, pinned)


def _followed(problem: OptimalControlProblem, trajectory: Trajectory) -> Vector:
    """Normalised instants at which a state bound or a path constraint becomes active or lets go."""
    found = [np.zeros(0)]
    controls = {f"/problem/bounds/{name}" for name in problem.controls}
    for item in constraint_margins(problem, trajectory):
        if item["pointer"] not in controls:
            for stretch in item["active"]:
                start, stop = trajectory.tau(np.array(stretch))
                found.append(np.array([start, stop] if stop - start > _TOUCH else [(start + stop) / 2.0]))
    return np.concatenate(found)


def _distinct(instants: Vector) -> Vector:
    """The instants in order between 0 and 1, without those next to another one or to an end."""
    kept = [0.0]
    for instant in np.sort(instants):
        if instant - kept[-1] > SHORTEST_ARC and 1.0 - instant > SHORTEST_ARC:
            kept.append(float(instant))
    return np.array([*kept, 1.0])
