"""What a verification says: tolerances, checks, the errors of each state, the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.verification.flight import INTEGRATOR, RTOL

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Tolerances:
    """Limits of a verified result, relative to each quantity's scale."""

    terminal_error: float = 1e-2
    state_error: float = 1e-2
    bound: float = 1e-2
    path: float = 1e-2


@dataclass(frozen=True)
class Check:
    """One comparison; ``value`` is None where it could not be computed, which fails."""

    name: str
    value: float | None
    limit: float

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit."""
        return self.value is not None and self.value <= self.limit

    @property
    def shortfall(self) -> float:
        """How many times its limit the value is; infinite where it was not computed."""
        if self.value is None or self.limit == 0.0:
            return 0.0 if self.passed else math.inf
        return self.value / self.limit

    @property
    def sentence(self) -> str:
        """The comparison in words."""
        found = "was not computed" if self.value is None else f"is {self.value:.7g}"
        return f"{self.name} {found}, the limit {self.limit:.7g}."


@dataclass(frozen=True)
class StateReport:
    """Errors of one state in its own units, and the time of the largest one between breakpoints."""

    terminal_error: float | None
    max_error: float | None
    at: float | None
    tolerance: float


@dataclass(frozen=True)
class Verification:
    """What the flight showed. Integrals, scaled maxima, a report for each state, the checks that decide."""

    terminal_error: float | None
    max_state_error: float | None
    max_bound_violation: float
    max_path_violation: float
    objective: float | None
    integrals: Mapping[str, float]
    growth: float | None
    states: Mapping[str, StateReport]
    tolerances: Tolerances
    checks: tuple[Check, ...]
    note: str
    hamiltonian_drift: float | None = None
    mesh_error_estimate: float | None = None
    end: Vector | None = None
    """The final state, (n,): as flown, or as promised where the flight says nothing of it."""
    parts: tuple[Verification, ...] = ()
    """Those of the phases of a flight."""

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    @property
    def shortfall(self) -> float:
        """That of the worst check: at most 1 where every check passed."""
        return max(check.shortfall for check in self.checks)

    def to_dict(self) -> dict[str, Any]:
        """The ``verification`` of a result."""
        return {
            "integrator": INTEGRATOR,
            "rtol": RTOL,
            "terminal_error": self.terminal_error,
            "max_state_error": self.max_state_error,
            "max_bound_violation": self.max_bound_violation,
            "max_path_violation": self.max_path_violation,
            "objective": self.objective,
            "integrals": dict(self.integrals),
            "hamiltonian_drift": self.hamiltonian_drift,
            "mesh_error_estimate": self.mesh_error_estimate,
            "growth": self.growth,
            "states": {
                name: {
                    "terminal_error": report.terminal_error,
                    "max_error": report.max_error,
                    "at": report.at,
                    "tolerance": report.tolerance,
                }
                for name, report in self.states.items()
            },
            "tolerances": vars(self.tolerances),
            "checks": [
                {"name": check.name, "value": check.value, "limit": check.limit, "passed": check.passed}
                for check in self.checks
            ],
            "passed": self.passed,
            "note": self.note,
        }
