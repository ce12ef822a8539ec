"""One solve as it runs: its limits, what it has told and spent, and the meshes that it went through."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, Generic, Self

import numpy as np
from numpy.typing import NDArray

from solvers.cache import STRUCTURES, CompiledStructure
from solvers.formulation.quantities import Constraint, Total
from solvers.optimizers.ipopt import Ipopt
from solvers.optimizers.newton import Newton
from solvers.optimizers.outcome import Iterate, Limits, Optimizer, Outcome
from solvers.part import Part
from solvers.problem import OptimalControlProblem
from solvers.program import NonlinearProgram
from solvers.progress import Progress, ProgressReport
from solvers.solution import Statistics
from solvers.solved import Ended, Optimisable, Solved, Stand
from solvers.start.scaling import Scaling
from solvers.status import SolveStatus
from solvers.transcription.base import Transcription

Vector = NDArray[np.float64]

# About how many iterations a mesh takes: only the estimate of the fraction done depends on it.
_USUAL_ITERATIONS = 30.0
# Time between two sketches of where a solve is (s), and their number of samples: a picture, not an answer.
_SKETCH_EVERY = 1.0
_SKETCH_SAMPLES = 41


@dataclass(kw_only=True)
class Account:
    """The limits of one document, and what its programs took and told.

    ``barrier``: where the barrier parameter of warm solves starts; None leaves it to the optimizer.
    """

    tolerance: float
    max_iterations: int
    limits: Limits
    progress: Progress
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0, "solve": 0.0, "refine": 0.0})
    convergence: list[dict[str, Any]] = field(default_factory=list)
    iterations: int = 0
    barrier: float | None = None
    next_sketch: float = field(default_factory=lambda: time.monotonic() + _SKETCH_EVERY)

    @property
    def stop(self) -> SolveStatus | None:
        """Why to begin nothing new: somebody asked to stop, or the time is over."""
        return self.limits.reached

    def optimise(
        self,
        transcription: Optimisable,
        stage: str,
        share: tuple[float, float] = (0.0, 1.0),
        *,
        warm: bool = False,
        obeys: bool = False,
        decided: bool = False,
    ) -> Outcome:
        """Solve one program. ``share``: the part of all work that it is; ``warm``: it starts near the answer;
        ``obeys``: from what obeys the model; ``decided``: its equations leave nothing to choose.

        Raises whatever the progress raises.
        """

        def report(iterate: Iterate) -> None:
            done = iterate.iteration / (iterate.iteration + _USUAL_ITERATIONS)
            self.progress.report(
                ProgressReport(
                    stage,
                    self.iterations + iterate.iteration,
                    iterate.objective * transcription.objective_scale,
                    iterate.infeasibility,
                    share[0] + done * (share[1] - share[0]),
                    trajectory=self._sketch(transcription, iterate),
                )
            )

        if decided:
            outcome = self._run(transcription, ("newton", self.tolerance), self._newton, report)
            if outcome.status is not SolveStatus.DIVERGED:
                return outcome
        # A key is also told by how the optimizer is set, which is compiled in.
        key = self.tolerance, self.max_iterations, warm, obeys, warm and self.barrier
        return self._run(transcription, key, partial(self._ipopt, warm=warm, obeys=obeys), report)

    def _run(
        self,
        transcription: Optimisable,
        settings: Hashable,
        optimizer_of: Callable[[NonlinearProgram], Optimizer],
        report: Callable[[Iterate], None],
    ) -> Outcome:
        """Solve a program by the optimizer of these settings, which may be known from a solve before."""
        started = time.perf_counter()
        key = transcription.key, settings
        known = STRUCTURES.take(key)
        if known is not None:
            transcription.builder = known.builder
        program = transcription.program()
        optimizer = known.optimizer if known is not None else optimizer_of(program)
        outcome = optimizer.minimise(program, self.limits, report)
        STRUCTURES.put(key, CompiledStructure(transcription.builder, optimizer))
        self.iterations += outcome.iterations
        self.seconds["build"] += time.perf_counter() - started - outcome.seconds
        self.seconds["solve"] += outcome.seconds
        return outcome

    def aside(self, part: Part, **changes: Any) -> Session:
        """What solves one part alone on this account, but for the ``changes``."""
        own = {item.name: getattr(self, item.name) for item in fields(Account)}
        return Session(**{**own, **changes}, problem=part.problem, scaling=part.scaling)

    def note(self, nodes: int, stage: str, outcome: Outcome, scale: float) -> None:
        """Take note of a mesh that was solved; ``scale``: that of its objective."""
        before = self.iterations - outcome.iterations
        self.convergence.append(
            {
                "level": len(self.convergence),
                "nodes": nodes,
                "objective": outcome.objective * scale,
                "max_state_error": None,
                "stage": stage,
                "iterates": [
                    [before + iteration, objective * scale, infeasibility]
                    for iteration, objective, infeasibility in outcome.iterates
                ],
            }
        )

    def _sketch(self, transcription: Optimisable, iterate: Iterate) -> dict[str, Any] | None:
        """Where an iterate is, on a coarse grid; None if that was told a moment ago, or is nowhere."""
        now = time.monotonic()
        if now < self.next_sketch or not np.all(np.isfinite(iterate.unknowns)):
            return None
        self.next_sketch = now + _SKETCH_EVERY
        return transcription.sketch(iterate.unknowns, _SKETCH_SAMPLES)

    def _newton(self, program: NonlinearProgram) -> Newton:
        return Newton(program, tolerance=self.tolerance)

    def _ipopt(self, program: NonlinearProgram, *, warm: bool, obeys: bool) -> Ipopt:
        return Ipopt(
            program,
            tolerance=self.tolerance,
            max_iterations=self.max_iterations,
            warm=warm,
            obeys=obeys,
            barrier=self.barrier if warm else None,
        )


@dataclass(kw_only=True)
class Solving(Account, Generic[Ended]):
    """Solves parts that belong together on mesh after mesh within the limits of one document.

    A problem without phases has one part. What is done with meshes and structures is done with those of each
    part, and solved for all of them together.
    """

    @property
    @abstractmethod
    def parts(self) -> Sequence[Part]:
        """The parts in their order."""

    @property
    @abstractmethod
    def joints(self) -> int:
        """The number of equations that join the parts."""

    @property
    @abstractmethod
    def over_all(self) -> tuple[Sequence[Total], Sequence[Constraint]]:
        """The integrals over all parts, and what else counts over all of them; nothing of a single one."""

    @abstractmethod
    def relaxed(self, parts: Sequence[Part], limits: Sequence[Constraint]) -> Self:
        """What solves these parts instead, with its own levels; over all of them count ``limits`` alone."""

    @abstractmethod
    def pinned(self, index: int) -> Part:
        """A part whose joints to other parts are where the guess has them."""

    @abstractmethod
    def carried(self, solved: Ended, index: int, error: Vector) -> Vector:
        """The error (n,) with which a part begins after that at the end of the part before it."""

    @abstractmethod
    def together(
        self, transcriptions: Sequence[Transcription], optimise: Callable[[Optimisable], Outcome]
    ) -> Ended:
        """What comes of the one program of all parts, each on its mesh, when that is optimised."""

    def solve_parts(
        self,
        transcriptions: Sequence[Transcription],
        stage: str,
        share: tuple[float, float] = (0.0, 1.0),
        *,
        warm: bool = False,
        obeys: bool = False,
        decided: bool = False,
    ) -> Ended:
        """Solve all parts, each on its mesh; see :meth:`Account.optimise`.

        Where several meet is guessed, however well they obey the model in between: from the low barrier that
        such starts are good for alone, they shrink to nothing.
        """
        obeys = obeys and len(transcriptions) == 1
        optimise = partial(self.optimise, stage=stage, share=share, warm=warm, obeys=obeys, decided=decided)
        solved = self.together(transcriptions, optimise)
        nodes = sum(int(part.trajectory.nodes.size) for part in solved.parts)
        self.note(nodes, stage, solved.outcome, solved.transcription.objective_scale)
        return solved


@dataclass(kw_only=True)
class Session(Solving[Solved]):
    """Solves a problem without phases."""

    problem: OptimalControlProblem
    scaling: Scaling

    @property
    def parts(self) -> Sequence[Part]:
        """See :class:`Solving`."""
        return (Part(self.problem, self.scaling),)

    @property
    def joints(self) -> int:
        """See :class:`Solving`."""
        return 0

    @property
    def over_all(self) -> tuple[Sequence[Total], Sequence[Constraint]]:
        """See :class:`Solving`."""
        return (), ()

    def relaxed(self, parts: Sequence[Part], limits: Sequence[Constraint]) -> Self:
        """See :class:`Solving`."""
        (part,) = parts
        return replace(self, problem=part.problem, scaling=part.scaling, convergence=[])

    def pinned(self, index: int) -> Part:
        """See :class:`Solving`."""
        return self.parts[index]

    def carried(self, solved: Solved, index: int, error: Vector) -> Vector:
        """See :class:`Solving`; there is no part before another one."""
        raise IndexError(index)

    def together(
        self, transcriptions: Sequence[Transcription], optimise: Callable[[Optimisable], Outcome]
    ) -> Solved:
        """See :class:`Solving`."""
        (transcription,) = transcriptions
        outcome = optimise(transcription)
        return Solved(transcription, outcome, transcription.trajectory(outcome.unknowns))


def statistics_of(answer: Stand[Any, Any], account: Account) -> Statistics:
    """The ``statistics`` of a result: the size of its program, and what all programs took."""
    builder = answer.transcription.builder
    outcome = answer.outcome
    return Statistics(
        builder.size,
        builder.row_count,
        account.iterations,
        outcome.solver_status,
        account.seconds,
        nlp_solver=outcome.solver,
    )


def start_report(answer: Stand[Any, Any], final_time: float, *, kept: bool) -> dict[str, Any]:
    """The entry of ``starts`` of a result: where a start led, and whether that answer was kept."""
    return {
        "objective": answer.objective,
        "final_time": final_time,
        "status": answer.outcome.status.value,
        "kept": kept,
    }
