"""What was solved, and how the optimizer ended on it: a problem on a mesh, or a flight of phases."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from solvers.certificate import hamiltonian_drift
from solvers.optimizers.outcome import Outcome
from solvers.problem import OptimalControlProblem
from solvers.program import NonlinearProgram
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.transcription.base import Transcription

Vector = NDArray[np.float64]

# A phase of this part of the flight is none.
_EMPTY = 1e-5


class Optimisable(Protocol):
    """What makes programs of one structure."""

    builder: Any

    @property
    def key(self) -> Hashable:
        """Equal for those whose programs differ in numbers only; they may share a builder."""
        ...

    @property
    def objective_scale(self) -> float:
        """What the objective of the program is multiplied by to give that of the document."""
        ...

    def program(self) -> NonlinearProgram:
        """The scaled program, with its start."""
        ...

    def sketch(self, unknowns: Vector, samples: int) -> dict[str, Any]:
        """The trajectory of (scaled) unknowns on a grid of so many samples."""
        ...


Made = TypeVar("Made", bound=Optimisable)
Found = TypeVar("Found")


@dataclass(frozen=True)
class Stand(Generic[Made, Found]):
    """What was solved, where the optimizer stopped on it, and the trajectory that this stands for."""

    transcription: Made
    outcome: Outcome
    trajectory: Found

    @property
    def converged(self) -> bool:
        """Whether the nonlinear program converged."""
        return self.outcome.status is SolveStatus.CONVERGED

    @property
    def stopped(self) -> bool:
        """Whether somebody or the clock asked to stop."""
        return self.outcome.status in (SolveStatus.CANCELLED, SolveStatus.TIME_LIMIT)

    @property
    def objective(self) -> float:
        """The objective of the document on this mesh."""
        return self.outcome.objective * self.transcription.objective_scale

    @property
    def collapsed(self) -> bool:
        """Whether a phase has next to no part of the flight.

        Nothing depends on its controls then, so that the optimizer may take that for an optimum, and nothing
        can be said of arcs along it.
        """
        return bool(self.empty_parts)

    @property
    def empty_parts(self) -> list[int]:
        """Which phases have next to no part of the flight."""
        durations = [part.trajectory.duration for part in self.parts]
        least = _EMPTY * sum(durations)
        return [index for index, duration in enumerate(durations) if duration <= least]

    @property
    @abstractmethod
    def parts(self) -> Sequence[Solved]:
        """What came of each phase, with the outcome of the whole; all of it where there are no phases."""


Ended = TypeVar("Ended", bound=Stand[Any, Any])
"""What comes of a session: of a plain problem, or of a flight of phases."""


@dataclass(frozen=True)
class Solved(Stand[Transcription, Trajectory]):
    """A problem on a mesh, and what came of it."""

    @property
    def weighted_problem(self) -> OptimalControlProblem:
        """The problem with its integrals, times their multipliers, in the running cost."""
        return self.transcription.weighted_problem(self.outcome.row_multipliers)

    @cached_property
    def costates(self) -> Vector:
        """Costates (n, K) at the nodes of the trajectory."""
        return self.transcription.costates(self.trajectory, self.outcome.row_multipliers)

    @cached_property
    def hamiltonian_drift(self) -> float | None:
        """How far the Hamiltonian wanders along it, see :func:`solvers.certificate.hamiltonian_drift`."""
        return hamiltonian_drift(self.weighted_problem, self.trajectory, self.costates)

    @property
    def parts(self) -> Sequence[Solved]:
        """See :class:`Stand`."""
        return (self,)
