"""One solve of a flight of phases as it runs: its meshes, and what came of each phase on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from solvers.formulation.quantities import FREE, Constraint, Total
from solvers.optimizers.outcome import Outcome
from solvers.part import Part
from solvers.phases.problem import PhasedProblem, begin_after
from solvers.phases.trajectory import PhasedTrajectory
from solvers.phases.transcription import PhasedTranscription
from solvers.session import Solving
from solvers.solved import Optimisable, Solved, Stand
from solvers.start.scaling import Scaling
from solvers.transcription.base import Transcription

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class PhasedSolved(Stand[PhasedTranscription, PhasedTrajectory]):
    """A flight on its meshes, and what came of it."""

    @cached_property
    def parts(self) -> Sequence[Solved]:
        """See :class:`~solvers.solved.Stand`: the transcriptions with their own parts of the outcome."""
        transcription, outcome = self.transcription, self.outcome
        shares = zip(
            transcription.parts,
            self.trajectory.parts,
            transcription.shares(outcome.unknowns),
            transcription.row_shares(outcome.row_multipliers),
            transcription.shares(outcome.bound_multipliers),
            strict=True,
        )
        return [
            Solved(
                part,
                replace(outcome, unknowns=unknowns, row_multipliers=rows, bound_multipliers=bounds),
                trajectory,
            )
            for part, trajectory, unknowns, rows, bounds in shares
        ]


@dataclass(kw_only=True)
class PhasedSession(Solving[PhasedSolved]):
    """Solves a flight of phases."""

    problem: PhasedProblem
    scaling: Sequence[Scaling]

    @property
    def parts(self) -> Sequence[Part]:
        """See :class:`~solvers.session.Solving`."""
        pairs = zip(self.problem.phases, self.scaling, strict=True)
        return [Part(phase.problem, scaling, phase.name) for phase, scaling in pairs]

    @property
    def joints(self) -> int:
        """See :class:`~solvers.session.Solving`."""
        over_all = [item.interval for item in self.problem.totals]
        over_all += [item.interval for item in self.problem.boundary]
        return self.problem.joints + sum(lower == upper for lower, upper in over_all)

    @property
    def over_all(self) -> tuple[Sequence[Total], Sequence[Constraint]]:
        """See :class:`~solvers.session.Solving`."""
        return self.problem.totals, self.problem.boundary

    def relaxed(self, parts: Sequence[Part], limits: Sequence[Constraint]) -> Self:
        """See :class:`~solvers.session.Solving`."""
        pairs = zip(self.problem.phases, parts, strict=True)
        problem = replace(
            self.problem,
            phases=tuple(replace(phase, problem=part.problem) for phase, part in pairs),
            totals=tuple(replace(item, interval=FREE) for item in self.problem.totals),
            boundary=tuple(limits),
            terminal_cost=None,
        )
        return replace(self, problem=problem, scaling=[part.scaling for part in parts], convergence=[])

    def pinned(self, index: int) -> Part:
        """See :class:`~solvers.session.Solving`."""
        part = self.parts[index]
        problem = part.problem
        begin, end = problem.guess.states_at(np.array([0.0, 1.0])).T
        if index:
            problem = replace(problem, initial_state=tuple(zip(begin, begin, strict=True)))
        if index < len(self.problem.phases) - 1:
            problem = replace(problem, final_state=tuple(zip(end, end, strict=True)))
        return replace(part, problem=problem)

    def carried(self, solved: PhasedSolved, index: int, error: Vector) -> Vector:
        """See :class:`~solvers.session.Solving`."""
        before, after = (phase.problem for phase in self.problem.phases[index - 1 : index + 1])
        link, flown = self.problem.links[index - 1], solved.trajectory.parts[index - 1]
        end, free = flown.states_at(np.ones(1))[:, 0], np.zeros(len(after.states))
        begins = [begin_after(link, before, flown, own, after, free) for own in (end, end + error)]
        return begins[1] - begins[0]

    def together(
        self, transcriptions: Sequence[Transcription], optimise: Callable[[Optimisable], Outcome]
    ) -> PhasedSolved:
        """See :class:`~solvers.session.Solving`."""
        joined = PhasedTranscription(self.problem, transcriptions)
        outcome = optimise(joined)
        return PhasedSolved(joined, outcome, joined.trajectory(outcome.unknowns))
