"""Verify a stored answer again: the document and the result are all that is needed."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from solvers.formulation.scenarios import formulate
from solvers.genetic.penalties import with_free_end
from solvers.genetic.residual import end_error, residual_check
from solvers.output.bundle import Bundle, BundleError
from solvers.phases.reading import phased_problem
from solvers.phases.trajectory import PhasedTrajectory, trajectory_of
from solvers.phases.verify import verify_phases
from solvers.piecewise.again import verify_again
from solvers.spec import GeneticMethod, JobSpec, PiecewiseMethod, check_text
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Tolerances, Verification
from solvers.verification.verify import verify

SECONDS = 600.0
"""Time for the flight, in seconds."""

FIGURES = (
    "terminal_error",
    "max_state_error",
    "max_bound_violation",
    "max_path_violation",
    "objective",
)
_AGREEMENT = 1e-6


@dataclass(frozen=True)
class Replay:
    """What the flight shows now, beside what the result says; ``same_document``: it is of this document."""

    verification: Verification
    stored: Mapping[str, Any]
    same_document: bool

    def figures(self) -> list[tuple[str, float | None, float | None]]:
        """List each figure as stored and as found now."""
        found = self.verification.to_dict()
        return [(name, self.stored.get(name), found[name]) for name in FIGURES]

    @property
    def differing(self) -> list[str]:
        """The figures that are not what the result says, to 1e-6 of what is larger than 1, else to 1e-6."""
        return [name for name, then, now in self.figures() if not _agree(then, now)]

    @property
    def confirmed(self) -> bool:
        """Whether the answer passes now, and is what it claims to be."""
        return self.verification.passed and self.same_document and not self.differing


def replay(bundle: Bundle) -> Replay:
    """Fly the answer of a bundle again.

    Raises DocumentError for a document that this version does not take, BundleError for a result that it
    cannot read.
    """
    if bundle.result is None:
        raise BundleError("the job has no result, so there is nothing to verify")
    spec = check_text(bundle.document)
    try:
        trajectory = trajectory_of(bundle.result)
        stored = bundle.result["verification"]
        limits = Tolerances(**{name: stored["tolerances"][name] for name in vars(Tolerances())})
        same = bundle.result["resolved"]["sha256"] == spec.resolved().sha256
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise BundleError(
            f"the result cannot be read by this version ({type(error).__name__}: {error})"
        ) from error
    if isinstance(trajectory, PhasedTrajectory):
        phased = phased_problem(spec.problem)
        found = verify_phases(phased, trajectory, limits, time.monotonic() + SECONDS)
    elif isinstance(spec.method, PiecewiseMethod):
        found = _mission(spec, spec.method, bundle.result, trajectory, limits)
    else:
        problem = formulate(spec.problem).plants[0].problem
        soft = isinstance(spec.method, GeneticMethod) and spec.method.ends_are_soft
        flown = with_free_end(problem) if soft else problem
        found = verify(flown, trajectory, limits, time.monotonic() + SECONDS)
        if soft:
            integrals = {item.name: found.integrals.get(item.name, math.nan) for item in problem.integrals}
            residual = end_error(problem, trajectory, integrals)
            check = residual_check(residual, trajectory, limits.terminal_error)
            found = replace(found, checks=(check, *found.checks))
    return Replay(found, stored, same)


def _mission(
    spec: JobSpec,
    method: PiecewiseMethod,
    result: Mapping[str, Any],
    trajectory: Trajectory,
    limits: Tolerances,
) -> Verification:
    try:
        return verify_again(spec.problem, method, result, trajectory, limits, SECONDS)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise BundleError(f"the mission cannot be read by this version ({type(error).__name__})") from error


def _agree(then: float | None, now: float | None) -> bool:
    if then is None or now is None:
        return then is now
    return abs(then - now) <= _AGREEMENT * max(1.0, abs(then))
