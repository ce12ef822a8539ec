"""From a first answer to the last one: its mesh adapted, its structure found, as the method asks."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Generic

from solvers.diagnosis import Place, diagnose
from solvers.meshes import adaptive_mesh_of, meshes_of
from solvers.phases.trajectory import AnyTrajectory
from solvers.refine.adaptive import Adapted, adapt
from solvers.refine.arcs import Refined
from solvers.refine.extremals import Extremal, other_extremals
from solvers.refine.residual import mesh_error_estimate
from solvers.refine.search import ACCEPTABLE
from solvers.refine.switching import Refinement, is_refinable, refine_switching, resume_switching
from solvers.session import Session, Solving
from solvers.solved import Ended, Solved
from solvers.spec import (
    Adaptivity,
    AutoMethod,
    HermiteSimpsonMethod,
    JobSpec,
    Method,
    SplineAdaptivity,
    SplineWaveletMethod,
)
from solvers.start.earlier import taken_over
from solvers.start.first_answer import first_answers
from solvers.status import SolveStatus
from solvers.switching import find_switching, is_switched
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Check, Verification

# The highest level to which the automatic choice refines: 500,000 intervals where they are needed.
_AUTOMATIC_LEVEL = 16
_SECOND_CHOICE_INTERVALS = 40
_FIRST_SPAN = 0.5
# The parts of the time that is left which meshes may take before the best one so far is the answer: where
# there is nothing better, and where there are arcs that are good enough but for what meshes may do better.
_LONGEST, _LONGEST_BESIDE = 1.0 / 3.0, 1.0 / 12.0
# After so many iterations another method is tried, where there is one: the cases take a tenth of them.
_FIRST_ITERATIONS = 300
# Of the accuracy asked for, what a structure may come to: it is estimated, and verified later.
_SAFE_PART = 0.8
# The estimated error of a mesh is within this factor of the true one: beyond it the tolerance is missed.
_CERTAINLY_OFF = 10.0
_SWITCHING_ADVICE = (
    " Where a control jumps between its bounds or slides between them, no mesh does what method.refine:"
    " switching does."
)
_AUTOMATIC_ADVICE = (
    " Ask for less (method.accuracy), give more time (options.max_seconds), or name a method:"
    ' {"name": "hermite_simpson", "adaptive": {"tolerance": 1e-6}} adapts another mesh,'
    ' and a fixed one, such as {"name": "swcm", "J": 6}, is verified to a hundredth.'
)
_NO_END = SolveStatus.ITERATION_LIMIT, SolveStatus.DIVERGED


@dataclass(frozen=True)
class Improved(Generic[Ended]):
    """An answer and how it was reached: on an adapted mesh, with a refined structure, or as it was.

    ``advice``: what to do where an adapted mesh does not reach its tolerance.
    """

    solved: Ended
    adapted: Adapted[Ended] | None = None
    adaptivity: Adaptivity | None = None
    refinement: Refinement[Ended] | None = None
    advice: str = ""

    @property
    def refined(self) -> Refined[Ended] | None:
        """The refined structure that the answer has; None if it has none."""
        return None if self.refinement is None else self.refinement.refined

    @property
    def summary(self) -> Mapping[str, Any]:
        """What was done, for the ``method`` of the result."""
        done: dict[str, Any] = {}
        if self.adapted is not None and self.adaptivity is not None:
            meshes = [dict(mesh.summary) for mesh in self.adapted.meshes]
            found = meshes[0] if len(meshes) == 1 else {"phases": meshes}
            done["adaptive"] = {**self.adaptivity.model_dump(), **found}
        if self.refinement is not None:
            done |= self.refinement.summary
        return done

    @property
    def warnings(self) -> Sequence[Mapping[str, str]]:
        """Why something that was asked for was not reached."""
        if self.refined is not None:
            return []
        found = [] if self.refinement is None else self.refinement.warnings
        reason = None if self.adapted is None else self.adapted.reason
        if reason is not None:
            found = [
                *found,
                {
                    "code": "tolerance_not_reached",
                    "pointer": "/method/adaptive",
                    "detail": reason + self.advice,
                },
            ]
        return found

    @property
    def mesh_errors(self) -> list[float | None]:
        """The largest relative error of a state on an arc, by part; a refined answer was judged by it."""
        if self.refined is not None:
            return [part.error for part in self.refined.parts]
        return [
            mesh_error_estimate(part.transcription.problem, part.trajectory) for part in self.solved.parts
        ]

    @property
    def switching(self) -> list[dict[str, Any]]:
        """The ``switching`` of the result, by part."""
        if self.refined is not None:
            parts = self.refined.parts
            return [part.structure.switching(part.problem, part.solved.trajectory) for part in parts]
        return [find_switching(part.transcription.problem, part.trajectory) for part in self.solved.parts]

    def certified(self, verification: Verification) -> Verification:
        """The verification with what else a refined answer, or one on an adapted mesh, must show."""
        if self.refinement is not None:
            verification = self.refinement.certified(verification)
        if self.refined is not None or self.adapted is None or self.adaptivity is None:
            return verification
        check = Check("mesh_error", self.adapted.error, _CERTAINLY_OFF * self.adaptivity.tolerance)
        return replace(verification, checks=(*verification.checks, check))


@dataclass(frozen=True)
class Reached(Generic[Ended]):
    """The last answer, the first ``answers`` (best first) and the method that they are by.

    ``diagnosis``: what stands against an answer, where there is none.
    """

    improved: Improved[Ended]
    answers: Sequence[Ended]
    method: Method
    diagnosis: Sequence[Mapping[str, Any]] = ()


def reach(
    session: Solving[Ended], spec: JobSpec, earlier: AnyTrajectory | None, place: Place
) -> Reached[Ended]:
    """All that is done for an answer; ``place``: where things stand in the document.

    Raises whatever the progress of the session raises.
    """
    resumed = _resume(session, spec.method, earlier)
    if resumed is not None:
        return Reached(resumed, [resumed.solved], first_methods(spec.method)[0])
    span = _first_span(spec.method)
    method, answers = _answers_of(session, spec, earlier, span)
    answers[0], diagnosis = diagnose(session, place, answers[0], meshes_of(method)[-1], span)
    return Reached(improve(session, spec.method, method, answers[0], span), answers, method, diagnosis)


def first_methods(method: Method) -> Sequence[Method]:
    """The methods of the first answer, each for where the one before does not converge.

    That of the document; wavelets, then Hermite-Simpson, where it leaves the choice.
    """
    if isinstance(method, AutoMethod):
        return [
            SplineWaveletMethod(name="swcm"),
            HermiteSimpsonMethod(name="hermite_simpson", intervals=_SECOND_CHOICE_INTERVALS),
        ]
    return [method]


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


def improve(
    session: Solving[Ended], method: Method, used: Method, first: Ended, span: float
) -> Improved[Ended]:
    """Improve a first answer by the method ``used``, ``span`` of all work, as ``method`` asks.

    Raises whatever the progress of the session raises.
    """
    if not first.converged:
        return Improved(first)
    if isinstance(method, AutoMethod):
        return _automatically(session, method, used, first, span)
    improved = Improved(first)
    if method.adaptivity is not None:
        improved = _adapted(session, method, method.adaptivity, first, span)
    if method.refinement is not None and improved.solved.converged:
        refinement = refine_switching(session, improved.solved)
        improved = replace(improved, solved=refinement.solved, refinement=refinement)
    return improved


def other_structures(
    session: Session, improved: Improved[Solved], count: int
) -> tuple[Improved[Solved], list[Extremal]]:
    """What else ``count`` starts find for a refined answer, and the answer, or a better one among these.

    Raises whatever the progress of the session raises.
    """
    if improved.refined is None or not count:
        return improved, []
    (refined,) = improved.refined.parts
    extremals = other_extremals(session, refined, count)
    better = next((item for item in extremals if item.obeys_signs), None)
    if better is not None and better.objective < improved.solved.objective:
        found = resume_switching(session, better.found.solved.trajectory.parts)
        if found is not None and found.solved.objective < improved.solved.objective:
            improved = replace(improved, solved=found.solved, refinement=found)
    return improved, extremals


def _adapted(
    session: Solving[Ended],
    method: Method,
    adaptivity: Adaptivity,
    first: Ended,
    span: float,
    seconds: float = math.inf,
) -> Improved[Ended]:
    """A first answer on adapted meshes of a method, which may take some ``seconds``."""
    meshes = [adaptive_mesh_of(method, part.problem) for part in session.parts]
    adapted = adapt(session, meshes, adaptivity.tolerance, first, span, seconds)
    bounded = any(map(is_switched, chain(*(part.problem.control_bounds for part in session.parts))))
    return Improved(adapted.solved, adapted, adaptivity, advice=_SWITCHING_ADVICE if bounded else "")


def _automatically(
    session: Solving[Ended], method: AutoMethod, used: Method, first: Ended, span: float
) -> Improved[Ended]:
    """The structure first, which is exact and cheap; an adapted mesh where it is not found.

    Or where between its nodes it leaves bounds or path constraints by more than is asked for, as polynomials
    do along constraints on several controls, or the Hamiltonian wanders; it stays where the mesh does not do
    better. Neither takes all of the time, so that there is an answer with what to do at the end of it.
    """
    exact = None
    if is_refinable(session.parts):
        acceptable = max(ACCEPTABLE, _SAFE_PART * method.accuracy)
        refinement = refine_switching(session, first, acceptable, _share_of_rest(session, _LONGEST))
        exact = Improved(refinement.solved, refinement=refinement)
        refined = refinement.refined
        if refinement.solved.stopped or (refined is not None and refined.is_certain(method.accuracy)):
            return exact
        exact = exact if refined is not None else None
    adaptivity = Adaptivity(tolerance=method.accuracy)
    if isinstance(used, SplineWaveletMethod):
        adaptivity = SplineAdaptivity(tolerance=method.accuracy, max_level=_AUTOMATIC_LEVEL)
    seconds = _share_of_rest(session, _LONGEST if exact is None else _LONGEST_BESIDE)
    meshed = used.model_copy(update={"adaptive": adaptivity})
    adapted = _adapted(session, meshed, adaptivity, first, span, seconds)
    if exact is None or not adapted.warnings:
        return replace(adapted, advice=_AUTOMATIC_ADVICE)
    return exact


def _share_of_rest(session: Solving[Any], share: float) -> float:
    """A share of the seconds that are left."""
    return share * max(0.0, session.limits.deadline - time.monotonic())
