"""What every optimizer is told, tells on its way, and comes back with."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from solvers.program import NonlinearProgram
from solvers.status import SolveStatus

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Iterate:
    """A moment of the optimization, in the scaled quantities of the program; ``unknowns`` (n,)."""

    iteration: int
    objective: float
    infeasibility: float
    unknowns: Vector


@dataclass(frozen=True)
class Outcome:
    """Where it stopped: ``unknowns`` (n,), ``row_multipliers`` (m,), ``bound_multipliers`` (n,).

    ``number_slopes``: the derivative of the Lagrangian with respect to the numbers of the program.
    ``iterates`` are the iterations that were watched, from the initial point to the last one, each with its
    objective and infeasibility. ``solver``: the optimizer's name. Where the program has no value at
    the initial point, all but the unknowns is NaN.
    """

    unknowns: Vector
    objective: float
    row_multipliers: Vector
    bound_multipliers: Vector
    number_slopes: Vector
    status: SolveStatus
    solver_status: str
    iterations: int
    iterates: Sequence[tuple[int, float, float]]
    seconds: float
    solver: str = "ipopt"


@dataclass(frozen=True)
class Limits:
    """When to stop: ``deadline`` is of ``time.monotonic()``; ``cancelled`` is asked every iteration."""

    deadline: float
    cancelled: Callable[[], bool]

    @property
    def reached(self) -> SolveStatus | None:
        """Why to go no further: the time is over, or somebody asked to stop."""
        if time.monotonic() >= self.deadline:
            return SolveStatus.TIME_LIMIT
        return SolveStatus.CANCELLED if self.cancelled() else None


class Optimizer(Protocol):
    """Solves programs of one structure, one at a time."""

    def minimise(
        self, program: NonlinearProgram, limits: Limits, report: Callable[[Iterate], None]
    ) -> Outcome:
        """Minimise the program from its initial point.

        Raises whatever ``report`` or ``limits.cancelled`` raised.
        """
        ...


def violation(program: NonlinearProgram, rows: Vector) -> float:
    """The largest violation of a constraint by the values ``rows`` (m,)."""
    below, above = program.constraint_lower - rows, rows - program.constraint_upper
    return float(max(0.0, np.max(below, initial=0.0), np.max(above, initial=0.0)))
