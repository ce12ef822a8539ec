"""How a solve can end: one word for programs, one sentence with advice for people."""

from __future__ import annotations

from enum import StrEnum


class SolveStatus(StrEnum):
    """The ``status`` of a result."""

    CONVERGED = "converged"
    INFEASIBLE = "infeasible"
    ITERATION_LIMIT = "iteration_limit"
    TIME_LIMIT = "time_limit"
    DIVERGED = "diverged"
    UNVERIFIED = "unverified"
    CANCELLED = "cancelled"
    EVALUATION_ERROR = "evaluation_error"

    @property
    def sentence(self) -> str:
        """What happened, and what to try next."""
        return _SENTENCES[self]


_SENTENCES = {
    SolveStatus.CONVERGED: (
        "The nonlinear program converged and the re-integrated answer is within tolerance."
    ),
    SolveStatus.INFEASIBLE: (
        "No feasible point was found from this guess. Check that the end conditions can be reached within "
        "the bounds, or give a better guess."
    ),
    SolveStatus.ITERATION_LIMIT: (
        "The iteration limit was reached before convergence. Raise options.max_iterations or give a better "
        "guess."
    ),
    SolveStatus.TIME_LIMIT: (
        "The time limit was reached before convergence. Raise options.max_seconds, or deadline_seconds where "
        "that was sooner."
    ),
    SolveStatus.DIVERGED: (
        "The iterates grew without bound or the optimizer failed. Bound the states and controls, check the "
        "scaling of the problem, or give a better guess."
    ),
    SolveStatus.UNVERIFIED: (
        "The nonlinear program converged, but the re-integrated answer is outside the verification "
        "tolerance. Use more nodes, a method whose control stays within its bounds between nodes (swcm), or "
        "method.refine: switching where controls jump between their bounds."
    ),
    SolveStatus.CANCELLED: "The solve was cancelled; this is the last iterate.",
    SolveStatus.EVALUATION_ERROR: "An expression has no finite value or slope where it was needed.",
}
