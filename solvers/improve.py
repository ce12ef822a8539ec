"""From a first answer to the last one: its mesh adapted, its structure found, as the method asks."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

from solvers.improved import Improved
from solvers.meshes import adaptive_mesh_of
from solvers.refine.adaptive import adapt
from solvers.refine.extremals import Extremal, other_extremals
from solvers.refine.search import ACCEPTABLE
from solvers.refine.switching import is_refinable, refine_switching, resume_switching
from solvers.session import Session, Solving
from solvers.solved import Ended, Solved
from solvers.spec import (
    Adaptivity,
    AutoMethod,
    HermiteSimpsonMethod,
    Method,
    SplineAdaptivity,
    SplineWaveletMethod,
)
from solvers.switching import is_switched

# The highest level to which the automatic choice refines: 500,000 intervals where they are needed.
_AUTOMATIC_LEVEL = 16
_SECOND_CHOICE_INTERVALS = 40
# The parts of the time that is left which meshes may take before the best one so far is the answer: where
# there is nothing better, and where there are arcs that are good enough but for what meshes may do better.
_LONGEST, _LONGEST_BESIDE = 1.0 / 3.0, 1.0 / 12.0
# Of the accuracy asked for, what a structure may come to: it is estimated, and verified later.
_SAFE_PART = 0.8
_SWITCHING_ADVICE = (
    " Where a control jumps between its bounds or slides between them, no mesh does what method.refine:"
    " switching does."
)
_AUTOMATIC_ADVICE = (
    " Ask for less (method.accuracy), give more time (options.max_seconds), or name a method:"
    ' {"name": "hermite_simpson", "adaptive": {"tolerance": 1e-6}} adapts another mesh,'
    ' and a fixed one, such as {"name": "swcm", "J": 6}, is verified to a hundredth.'
)


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


def improvements(
    session: Solving[Ended], method: Method, used: Method, first: Ended, span: float
) -> Iterator[Improved[Ended]]:
    """What ``method`` asks for from a first answer by the method ``used``, ``span`` of all work.

    Where the choice is left to the solver, what else there is follows, should the first not be verified.
    Raises whatever the progress of the session raises.
    """
    if not first.converged:
        yield Improved(first)
    elif isinstance(method, AutoMethod):
        yield from _automatically(session, method, used, first, span)
    else:
        improved = Improved(first)
        if method.adaptivity is not None:
            improved = _adapted(session, method, method.adaptivity, first, span)
        if method.refinement is not None and improved.solved.converged:
            refinement = refine_switching(session, improved.solved)
            improved = replace(improved, solved=refinement.solved, refinement=refinement)
        yield improved


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
) -> Iterator[Improved[Ended]]:
    """The structure first, which is exact and cheap; an adapted mesh where it is not found.

    Or where between its nodes it leaves bounds or path constraints by more than is asked for, as polynomials
    do along constraints on several controls, or the Hamiltonian wanders; it stays where the mesh does not do
    better. Neither takes all of the time, so that there is an answer with what to do at the end of it.
    """
    exact, certain = None, False
    if is_refinable(session.parts):
        acceptable = max(ACCEPTABLE, _SAFE_PART * method.accuracy)
        refinement = refine_switching(session, first, acceptable, _share_of_rest(session, _LONGEST))
        found = Improved(refinement.solved, refinement=refinement)
        refined = refinement.refined
        if refinement.solved.stopped:
            yield found
            return
        if refined is not None:
            exact, certain = found, refined.is_certain(method.accuracy)
    if exact is not None and certain:
        yield exact
    adaptivity = Adaptivity(tolerance=method.accuracy)
    if isinstance(used, SplineWaveletMethod):
        adaptivity = SplineAdaptivity(tolerance=method.accuracy, max_level=_AUTOMATIC_LEVEL)
    seconds = _share_of_rest(session, _LONGEST if exact is None else _LONGEST_BESIDE)
    meshed = used.model_copy(update={"adaptive": adaptivity})
    adapted = replace(_adapted(session, meshed, adaptivity, first, span, seconds), advice=_AUTOMATIC_ADVICE)
    if exact is None or certain:
        yield adapted
    else:
        yield from (exact, adapted) if adapted.warnings else (adapted, exact)


def _share_of_rest(session: Solving[Any], share: float) -> float:
    """A share of the seconds that are left."""
    return share * max(0.0, session.limits.deadline - time.monotonic())
