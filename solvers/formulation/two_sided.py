"""Controls that cost their magnitude, as the difference of what they push forth and back.

A fuel |u| has a corner at 0, which is where an optimum rests. As u = p - n with 0 <= p <= upper and
0 <= n <= -lower it costs p + n: at an optimum one of both is 0, so that the cost is the same, and 0 is a
bound on which arcs rest like on the others: bang-off-bang controls are solved for with exact instants.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solvers.curves import Curve, at_the_same_nodes, through
from solvers.expressions import Expression, combined, named
from solvers.formulation.other_controls import NewControl, may_be_replaced, with_other_controls
from solvers.problem import OptimalControlProblem

_FORTH, _BACK = "forth@", "back@"


@dataclass(frozen=True)
class TwoSides:
    """A control as the difference of two others."""

    control: str

    @property
    def controls(self) -> tuple[str, ...]:
        """The control of the document."""
        return (self.control,)

    @property
    def forth(self) -> str:
        """The name of what pushes forth."""
        return _FORTH + self.control

    @property
    def back(self) -> str:
        """The name of what pushes back."""
        return _BACK + self.control

    @property
    def magnitude(self) -> Expression:
        """What stands for the magnitude of the control where that costs."""
        return combined("+", named(self.forth), named(self.back))

    @property
    def difference(self) -> Expression:
        """The control."""
        return combined("-", named(self.forth), named(self.back))

    def components(self, controls: Mapping[str, Curve]) -> dict[str, Curve]:
        """The curve of the control from those of both sides."""
        return {self.control: at_the_same_nodes(controls[self.forth], controls[self.back], np.subtract)}

    def replaced(self, controls: Mapping[str, Curve]) -> dict[str, Curve]:
        """The curves of both sides from that of the control."""
        curve = controls[self.control]
        return {
            self.forth: through(curve, lambda values: np.maximum(values, 0.0)),
            self.back: through(curve, lambda values: np.maximum(-values, 0.0)),
        }

    def switching(self, found: Mapping[str, Any]) -> dict[str, Any]:
        """The ``switching`` of the control from those of both sides."""
        forth, back = found[self.forth], found[self.back]
        times, levels, arcs = list[float](), list[float | None](), list[str]()
        for start in [-np.inf, *sorted({*forth["times"], *back["times"]})]:
            ahead, behind = (bisect_right(side["times"], start) for side in (forth, back))
            level, kind = None, "interior"
            if (forth["arcs"][ahead], back["arcs"][behind]) == ("upper", "lower"):
                level, kind = forth["levels"][ahead], "upper"
            elif (forth["arcs"][ahead], back["arcs"][behind]) == ("lower", "upper"):
                level, kind = -back["levels"][behind], "lower"
            if not arcs or kind != arcs[-1]:
                times.append(start)
                levels.append(level)
                arcs.append(kind)
        return {"times": times[1:], "levels": levels, "arcs": arcs}


def may_be_split(problem: OptimalControlProblem) -> list[TwoSides]:
    """The controls that have room on both sides of 0 and may be replaced."""
    return [
        TwoSides(name)
        for name, (lower, upper) in zip(problem.controls, problem.control_bounds, strict=True)
        if -np.inf < lower < 0.0 < upper < np.inf and may_be_replaced(problem, name)
    ]


def sides_of(problem: OptimalControlProblem) -> tuple[TwoSides, ...]:
    """The controls that stand as two sides in a problem that is solved."""
    return tuple(TwoSides(name[len(_FORTH) :]) for name in problem.controls if name.startswith(_FORTH))


def with_sides(problem: OptimalControlProblem, sides: Sequence[TwoSides]) -> OptimalControlProblem:
    """The problem with two sides in the place of some controls, which become definitions."""
    new = []
    for side in sides:
        index = problem.controls.index(side.control)
        (lower, upper), (tau, values) = problem.control_bounds[index], problem.guess.controls[index]
        new.append(NewControl(side.forth, (0.0, upper), (tau, np.maximum(values, 0.0))))
        new.append(NewControl(side.back, (0.0, -lower), (tau, np.maximum(-values, 0.0))))
    return with_other_controls(problem, {side.control: side.difference for side in sides}, new)
