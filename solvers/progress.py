"""What a running solve tells, and how it hears that nobody waits for it any more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True, slots=True)
class ProgressReport:
    """A moment of a solve: ``fraction`` in [0, 1] is an estimate, ``None`` where there is none.

    ``diversity``: of a population, how far its genes are from their mean. ``trajectory``: now and then where
    the iterate is, coarsely, as in a result.
    """

    stage: str
    iteration: int
    objective: float | None = None
    infeasibility: float | None = None
    fraction: float | None = None
    diversity: float | None = None
    trajectory: Mapping[str, Any] | None = None


class Progress(Protocol):
    """Receives reports and is asked, between iterations, whether to stop.

    Both methods are called often (every iteration): an implementation throttles what is expensive.
    """

    def report(self, report: ProgressReport) -> None:
        """Take note of a moment of the solve."""

    def cancelled(self) -> bool:
        """Tell whether the solve should stop now; its last iterate is kept."""
        ...


class SilentProgress:
    """The default: nobody watches, nobody cancels."""

    def report(self, report: ProgressReport) -> None:
        """Ignore the report."""

    def cancelled(self) -> bool:
        """Never stop."""
        return False
