"""One solve of a flight of phases as it runs: from where each starts to the answer on the finest meshes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from solvers.first_answer import continued, from_starts, rank
from solvers.guess import Start, WarmStart
from solvers.meshes import Mesh
from solvers.minimum_energy import minimum_energy_start
from solvers.phases.problem import PhasedProblem
from solvers.phases.trajectory import PhasedTrajectory
from solvers.phases.transcription import PhasedTranscription
from solvers.problem import OptimalControlProblem
from solvers.scaling import Scaling
from solvers.session import Account, Session, Solved, Stand
from solvers.starts import several_starts

Vector = NDArray[np.float64]
Starts = Sequence[Start]
"""A start for each phase."""


@dataclass(frozen=True)
class PhasedSolved(Stand[PhasedTranscription, PhasedTrajectory]):
    """A flight on its meshes, and what came of it."""

    @property
    def parts(self) -> list[Solved]:
        """What came of each phase: its transcription with its own part of the outcome."""
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
class PhasedSession(Account):
    """Solves a flight on meshes after meshes within the limits of one document."""

    problem: PhasedProblem
    scaling: Sequence[Scaling]

    def solve(
        self,
        transcription: PhasedTranscription,
        stage: str,
        share: tuple[float, float] = (0.0, 1.0),
        *,
        warm: bool = False,
    ) -> PhasedSolved:
        """Solve on one mesh for each phase; see :meth:`~solvers.session.Account.optimise`."""
        outcome = self.optimise(transcription, stage, share, warm=warm)
        solved = PhasedSolved(transcription, outcome, transcription.trajectory(outcome.unknowns))
        nodes = sum(int(part.nodes.size) for part in solved.trajectory.parts)
        self.note(nodes, stage, outcome, transcription.objective_scale)
        return solved

    def transcription(self, mesh: Mesh, starts: Starts) -> PhasedTranscription:
        """Every phase on the same mesh, from a start of its own."""
        triples = zip(self.problem.phases, self.scaling, starts, strict=True)
        parts = [mesh(phase.problem, scaling, start) for phase, scaling, start in triples]
        return PhasedTranscription(self.problem, parts)

    def first_answers(
        self, meshes: Sequence[Mesh], starts: int, earlier: PhasedTrajectory | None, span: float
    ) -> list[PhasedSolved]:
        """Answers on the finest mesh, best first; see :func:`solvers.first_answer.first_answers`."""
        answers = self._from_earlier(meshes[-1], earlier, span) or from_starts(
            self._starts(starts),
            starts,
            span,
            lambda first, stage, share: self._continue(meshes, first, stage, share),
        )
        return sorted(answers, key=rank)

    def _from_earlier(self, mesh: Mesh, earlier: PhasedTrajectory | None, span: float) -> list[PhasedSolved]:
        if earlier is None:
            return []
        starts = [
            WarmStart(part, phase.problem.guess, phase.problem.states, phase.problem.controls)
            for part, phase in zip(earlier.parts, self.problem.phases, strict=True)
        ]
        transcription = self.transcription(mesh, starts)
        solved = self.solve(transcription, "solve from the earlier job", (0.0, span), warm=True)
        return [solved] if solved.converged or solved.stopped else []

    def _continue(
        self, meshes: Sequence[Mesh], first: Starts, stage: str, share: tuple[float, float]
    ) -> PhasedSolved:
        def solve_on(
            index: int, start: Starts | PhasedTrajectory, label: str, part: tuple[float, float], warm: bool
        ) -> PhasedSolved:
            starts = start.parts if isinstance(start, PhasedTrajectory) else start
            return self.solve(self.transcription(meshes[index], starts), label, part, warm=warm)

        return continued(self, len(meshes), solve_on, first, stage, share)

    def _starts(self, count: int) -> Iterator[Starts]:
        """The guesses, or what obeys the models between their ends, then the starts beside them."""
        pairs = list(zip(self.problem.phases, self.scaling, strict=True))
        several = [several_starts(phase.problem, scaling, count) for phase, scaling in pairs]
        yield [self._first_start(index, own[0]) for index, own in enumerate(several)]
        yield from zip(*(own[1:] for own in several), strict=True)

    def _first_start(self, index: int, guess: Start) -> Start:
        account = {item.name: getattr(self, item.name) for item in fields(Account)}
        alone = Session(**account, problem=self._pinned(index), scaling=self.scaling[index])
        start = minimum_energy_start(alone)
        self.iterations = alone.iterations
        return start or guess

    def _pinned(self, index: int) -> OptimalControlProblem:
        """The problem of a phase whose joints to other phases are where the guess has them."""
        problem = self.problem.phases[index].problem
        begin, end = problem.guess.states_at(np.array([0.0, 1.0])).T
        if index:
            problem = replace(problem, initial_state=tuple(zip(begin, begin, strict=True)))
        if index < len(self.problem.phases) - 1:
            problem = replace(problem, final_state=tuple(zip(end, end, strict=True)))
        return problem
