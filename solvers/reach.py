"""From a document to the answer of its result: the first answers, improved until one is verified."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from solvers.diagnosis import Place, diagnose
from solvers.improve import first_methods, improvements
from solvers.improved import Improved
from solvers.meshes import meshes_of
from solvers.phases.trajectory import AnyTrajectory
from solvers.refine.switching import resume_switching
from solvers.session import Solving
from solvers.solved import Ended
from solvers.spec import AutoMethod, JobSpec, Method
from solvers.start.earlier import taken_over
from solvers.start.first_answer import first_answers
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Verification

_FIRST_SPAN = 0.5
# After so many iterations another method is tried, where there is one: the cases take a tenth of them.
_FIRST_ITERATIONS = 300
_NO_END = SolveStatus.ITERATION_LIMIT, SolveStatus.DIVERGED


class Flight(Protocol):
    """An answer of one plant, flown."""

    @property
    def verification(self) -> Verification:
        """What the flight showed."""
        ...


Flown = TypeVar("Flown", bound=Flight)


@dataclass(frozen=True)
class Reached(Generic[Ended, Flown]):
    """The last answer with the flights of its plants, the first ``answers`` (best first) and their method.

    ``diagnosis``: what stands against an answer, where there is none.
    """

    improved: Improved[Ended]
    flights: Sequence[Flown]
    answers: Sequence[Ended]
    method: Method
    diagnosis: Sequence[Mapping[str, Any]] = ()


def reach(
    session: Solving[Ended],
    spec: JobSpec,
    earlier: AnyTrajectory | None,
    place: Place,
    fly: Callable[[Improved[Ended]], Sequence[Flown]],
) -> Reached[Ended, Flown]:
    """All that is done for an answer; ``place``: where things stand in the document; ``fly``: all plants.

    Raises whatever the progress of the session raises.
    """
    resumed = _resume(session, spec.method, earlier)
    if resumed is not None:
        flights = fly(resumed)
        if shortfall(flights) <= 1.0:
            return Reached(resumed, flights, [resumed.solved], first_methods(spec.method)[0])
    span = _first_span(spec.method)
    method, answers = _answers_of(session, spec, earlier, span)
    answers[0], diagnosis = diagnose(session, place, answers[0], meshes_of(method)[-1], span)
    improved, flights = best_flown(improvements(session, spec.method, method, answers[0], span), fly)
    return Reached(improved, flights, answers, method, diagnosis)


def best_flown(
    answers: Iterator[Improved[Ended]], fly: Callable[[Improved[Ended]], Sequence[Flown]]
) -> tuple[Improved[Ended], Sequence[Flown]]:
    """The first of the answers that is verified, else that which misses its limits least, and its flights.

    No further answer is asked for than is needed, nor after one that was stopped.
    """
    best, least = None, float("inf")
    for answer in answers:
        flights = fly(answer)
        missed = shortfall(flights)
        if best is None or missed < least:
            best, least = (answer, flights), missed
        if least <= 1.0 or answer.solved.stopped:
            break
    assert best is not None
    return best


def shortfall(flights: Sequence[Flight]) -> float:
    """That of the worst of the flights; see :attr:`Verification.shortfall`."""
    return max(flight.verification.shortfall for flight in flights)


def _first_span(method: Method) -> float:
    """The part of all work that a first answer is taken to be: all of it where it is the last one."""
    more = isinstance(method, AutoMethod) or method.adaptivity is not None or method.refinement is not None
    return _FIRST_SPAN if more else 1.0


def _answers_of(
    session: Solving[Ended],
    spec: JobSpec,
    earlier: AnyTrajectory | None,
    span: float,
) -> tuple[Method, list[Ended]]:
    """The first answers, best first, and the method that they are by; see :func:`first_answers`.

    Another method is tried where the choice is left to the solver and the first one comes to no end, or loses
    a phase. Raises whatever the progress of the session raises.
    """
    methods, limit = first_methods(spec.method), session.max_iterations
    tried = list[tuple[Method, list[Ended]]]()
    for method in methods:
        session.max_iterations = limit if method is methods[-1] else min(limit, _FIRST_ITERATIONS)
        answers = first_answers(session, meshes_of(method), spec.options.starts, earlier, span)
        tried.append((method, answers))
        best = answers[0]
        if best.stopped or not (best.outcome.status in _NO_END or best.collapsed):
            break
    session.max_iterations = limit
    if answers[0].collapsed:  # no method keeps that phase: the first one that converged is as good
        return next((item for item in tried if item[1][0].converged), tried[-1])
    return method, answers


def _resume(session: Solving[Ended], method: Method, earlier: AnyTrajectory | None) -> Improved[Ended] | None:
    """The answer that the structure of an earlier one leads to, where the method asks for a structure.

    None where none is asked for or it leads to none. Raises whatever the progress of the session raises.
    """
    if earlier is None or not (isinstance(method, AutoMethod) or method.refinement is not None):
        return None
    pieces = taken_over(earlier, session.parts)
    whole = [piece for piece in pieces if isinstance(piece, Trajectory)]
    refinement = resume_switching(session, whole) if len(whole) == len(pieces) else None
    return None if refinement is None else Improved(refinement.solved, refinement=refinement)
