"""What becomes of a first answer: its mesh adapted, its structure found, as the method asks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from solvers.meshes import adaptive_mesh_of
from solvers.problem import OptimalControlProblem
from solvers.refine.adaptive import Adapted, adapt
from solvers.refine.extremals import Extremal, other_extremals
from solvers.refine.residual import mesh_error_estimate
from solvers.refine.switching import Refinement, is_refinable, refine_switching, resume_switching
from solvers.session import Session, Solved
from solvers.spec import (
    Adaptivity,
    AutoMethod,
    HermiteSimpsonMethod,
    Method,
    SplineAdaptivity,
    SplineWaveletMethod,
)
from solvers.switching import find_switching
from solvers.trajectory import Trajectory
from solvers.verification import Verification

# The highest level to which the automatic choice refines: 500,000 intervals where they are needed.
_AUTOMATIC_LEVEL = 16
_SECOND_CHOICE_INTERVALS = 40


@dataclass(frozen=True)
class Improved:
    """An answer and how it was reached: on an adapted mesh, with a refined structure, or as it was."""

    solved: Solved
    adapted: Adapted | None = None
    adaptivity: Adaptivity | None = None
    refinement: Refinement | None = None

    @property
    def summary(self) -> Mapping[str, Any]:
        """What was done, for the ``method`` of the result."""
        done: dict[str, Any] = {}
        if self.adapted is not None and self.adaptivity is not None:
            done["adaptive"] = {**self.adaptivity.model_dump(), **self.adapted.mesh.summary}
        if self.refinement is not None:
            done |= self.refinement.summary
        return done

    @property
    def warnings(self) -> Sequence[Mapping[str, str]]:
        """Why something that was asked for was not reached."""
        if self.refinement is not None and self.refinement.refined is not None:
            return []
        found = [] if self.refinement is None else self.refinement.warnings
        reason = None if self.adapted is None else self.adapted.reason
        if reason is not None:
            found = [
                *found,
                {"code": "tolerance_not_reached", "pointer": "/method/adaptive", "detail": reason},
            ]
        return found

    def mesh_error(self, problem: OptimalControlProblem) -> float | None:
        """The largest relative error of a state on an arc, which a refined answer was already judged by."""
        if self.refinement is not None and self.refinement.refined is not None:
            return self.refinement.refined.error
        return mesh_error_estimate(problem, self.solved.trajectory)

    def switching(self, problem: OptimalControlProblem) -> dict[str, Any]:
        """The ``switching`` of the result."""
        if self.refinement is None:
            return find_switching(problem, self.solved.trajectory)
        return self.refinement.switching(problem)

    def certified(self, verification: Verification) -> Verification:
        """The verification with what else a refined answer must show."""
        return verification if self.refinement is None else self.refinement.certified(verification)


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


def wants_more(method: Method) -> bool:
    """Whether a first answer is not the last one."""
    return isinstance(method, AutoMethod) or method.adaptivity is not None or method.refinement is not None


def resume(session: Session, method: Method, earlier: Trajectory | None) -> Improved | None:
    """The answer that the structure of an earlier one leads to, where the method asks for a structure.

    None where none is asked for or it leads to none. Raises whatever the progress of the session raises.
    """
    if earlier is None or not (isinstance(method, AutoMethod) or method.refinement is not None):
        return None
    refinement = resume_switching(session, earlier)
    return None if refinement is None else Improved(refinement.solved, refinement=refinement)


def improve(session: Session, method: Method, used: Method, first: Solved, span: float) -> Improved:
    """Improve a first answer by the method ``used``, ``span`` of all work, as ``method`` asks.

    Raises whatever the progress of the session raises.
    """
    if not first.converged:
        return Improved(first)
    if isinstance(method, AutoMethod):
        return _automatically(session, method, used, first, span)
    improved = Improved(first)
    if method.adaptivity is not None:
        adapted = adapt(
            session, adaptive_mesh_of(method, session.problem), method.adaptivity.tolerance, first, span
        )
        improved = Improved(adapted.solved, adapted, method.adaptivity)
    if method.refinement is not None and improved.solved.converged:
        refinement = refine_switching(session, improved.solved)
        improved = replace(improved, solved=refinement.solved, refinement=refinement)
    return improved


def other_structures(session: Session, improved: Improved, count: int) -> tuple[Improved, list[Extremal]]:
    """What else ``count`` starts find for a refined answer, and the answer, or a better one among these.

    Raises whatever the progress of the session raises.
    """
    refinement = improved.refinement
    if refinement is None or refinement.refined is None or not count:
        return improved, []
    extremals = other_extremals(session, refinement.refined, count)
    better = next((item for item in extremals if item.obeys_signs), None)
    if better is not None and better.objective < improved.solved.objective:
        found = resume_switching(session, better.found.solved.trajectory)
        if found is not None and found.solved.objective < improved.solved.objective:
            improved = replace(improved, solved=found.solved, refinement=found)
    return improved, extremals


def _automatically(
    session: Session, method: AutoMethod, used: Method, first: Solved, span: float
) -> Improved:
    """The structure first, which is exact and cheap; an adapted mesh where it is not found."""
    if is_refinable(session.problem):
        refinement = refine_switching(session, first)
        if refinement.refined is not None or refinement.solved.stopped:
            return Improved(refinement.solved, refinement=refinement)
    adaptivity = Adaptivity(tolerance=method.accuracy)
    if isinstance(used, SplineWaveletMethod):
        adaptivity = SplineAdaptivity(tolerance=method.accuracy, max_level=_AUTOMATIC_LEVEL)
    mesh = adaptive_mesh_of(used.model_copy(update={"adaptive": adaptivity}), session.problem)
    adapted = adapt(session, mesh, method.accuracy, first, span)
    return Improved(adapted.solved, adapted, adaptivity)
