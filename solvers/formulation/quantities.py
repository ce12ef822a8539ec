"""What a problem names besides states and controls: constraints, outputs, integrals, design parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.expressions import Expression

Interval = tuple[float, float]
FREE: Interval = (-np.inf, np.inf)
WHOLE_SPAN: Interval = (0.0, 1.0)

_ROUNDING = 1e-12


@dataclass(frozen=True)
class Constraint:
    """An expression held within ``interval``; ``pointer`` is its place in the document.

    ``during``: the part of normalised time in which a constraint along the trajectory holds. ``scale``: the
    size of the quantity where that is known beforehand; it is judged by its own values otherwise.
    """

    name: str
    pointer: str
    expression: Expression
    interval: Interval
    during: Interval = WHOLE_SPAN
    scale: float = 0.0

    def holds_at(self, tau: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the constraint holds at these normalised times."""
        start, stop = self.during
        return np.asarray((tau >= start - _ROUNDING) & (tau <= stop + _ROUNDING))

    def excess(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far values of the expression are outside of the interval, 0 inside."""
        lower, upper = self.interval
        return np.maximum(np.maximum(lower - values, values - upper), 0.0)


@dataclass(frozen=True)
class NamedQuantity:
    """An expression along the trajectory that is sampled for the result."""

    name: str
    expression: Expression
    units: str = ""


@dataclass(frozen=True)
class Integral:
    """The integral of an expression over the flight, held within ``interval``."""

    name: str
    pointer: str
    expression: Expression
    interval: Interval = FREE


@dataclass(frozen=True)
class Total:
    """What adds up over the parts of a flight under one name, held within ``interval``."""

    name: str
    pointer: str
    interval: Interval = FREE


@dataclass(frozen=True)
class DesignParameter:
    """A parameter that is optimised too, within ``interval``, from ``guess``."""

    name: str
    interval: Interval
    guess: float
