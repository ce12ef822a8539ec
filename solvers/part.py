"""One of the problems that are solved together."""

from __future__ import annotations

from dataclasses import dataclass

from solvers.problem import OptimalControlProblem
from solvers.start.scaling import Scaling


@dataclass(frozen=True)
class Part:
    """A problem with its scales: that of a phase with its name, or all there is where there are none."""

    problem: OptimalControlProblem
    scaling: Scaling
    name: str = ""
