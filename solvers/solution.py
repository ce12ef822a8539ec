"""The answer to a document, and the result JSON that it becomes."""

from __future__ import annotations

import math
import platform
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.coefficients import encode
from solvers.formulation.plants import Plant
from solvers.output.aftermath import asked_for
from solvers.output.report import constraint_margins
from solvers.output.sampling import output_extremes, sample
from solvers.phases.trajectory import AnyTrajectory
from solvers.problem import OptimalControlProblem
from solvers.spec import JobSpec
from solvers.spec.places import place_in_document
from solvers.status import SolveStatus
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Verification

Vector = NDArray[np.float64]

_ONLY_FLOATS = {float}

# Times that are closer than this part of the whole are the same.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Statistics:
    """The size of the nonlinear program and what its solution took."""

    variables: int
    constraints: int
    iterations: int
    nlp_status: str | None
    seconds: Mapping[str, float]
    nlp_solver: str | None = "ipopt"


@dataclass(frozen=True)
class PlantAnswer:
    """One of several plants under a command: its part of the answer, and what its flight showed."""

    plant: Plant
    trajectory: Trajectory
    verification: Verification


@dataclass(frozen=True, kw_only=True)
class Answer(ABC):
    """What a solve comes to; ``success`` says that the program converged and the proof holds."""

    spec: JobSpec
    objective: float
    status: SolveStatus
    message: str
    method: Mapping[str, Any]
    verification: Verification
    integrals: Mapping[str, float]
    model_report: Mapping[str, Any] | None
    switching: Mapping[str, Any]
    constraints: Sequence[Mapping[str, Any]]
    convergence: Sequence[Mapping[str, Any]]
    starts: Sequence[Mapping[str, Any]]
    warnings: Sequence[Mapping[str, Any]]
    statistics: Statistics
    sensitivity: Mapping[str, float | None] | None = None
    """Derivative of the objective with respect to parameters and bounds by pointer; None if not computed."""
    diagnosis: Sequence[Mapping[str, Any]] | None = None
    """What would have to give where no feasible point was found; None where a method does not look."""
    extras: Mapping[str, Any] = field(default_factory=dict)
    """What a method adds to the result, by key."""

    @property
    def success(self) -> bool:
        """Whether this is a converged and verified answer."""
        return self.status is SolveStatus.CONVERGED

    @property
    @abstractmethod
    def span(self) -> tuple[float, float]:
        """Initial and final time."""

    @abstractmethod
    def curves(self, times: Vector) -> dict[str, Any]:
        """What the result says of the trajectory, which is sampled at these times, by key."""

    def result(self, job_id: str | None = None) -> dict[str, Any]:
        """The result of this solution: JSON types only; what is not finite or not computed is None."""
        plain: dict[str, Any] = {
            "job_id": job_id,
            "success": self.success,
            "status": self.status.value,
            "message": self.message,
            "objective": self.objective,
            "final_time": self.span[1],
            "method": dict(self.method),
            **self.curves(self.sample_times()),
            "integrals": dict(self.integrals),
            "switching": dict(self.switching),
            "verification": self.verification.to_dict(),
            "statistics": {
                "variables": self.statistics.variables,
                "constraints": self.statistics.constraints,
                "iterations": self.statistics.iterations,
                "nlp_solver": self.statistics.nlp_solver,
                "nlp_status": self.statistics.nlp_status,
                "seconds": dict(self.statistics.seconds),
            },
            "constraints": list(self.constraints),
            "sensitivity": None if self.sensitivity is None else dict(self.sensitivity),
            "diagnosis": list(self.diagnosis) if self.diagnosis else None,
            "convergence": list(self.convergence),
            "starts": list(self.starts),
            "warnings": list(self.warnings),
            "model_report": self.model_report,
            **self.extras,
        }
        plain |= self.asked_for()
        return {
            **{key: finite(value) for key, value in plain.items()},
            "resolved": self.spec.resolved().to_dict(),
            "provenance": {**provenance(), "seed": getattr(self.spec.method, "seed", None)},
        }

    def asked_for(self) -> dict[str, Any]:
        """What the document asks for besides: its command table, and coasting."""
        found, warnings = asked_for(self.spec, self.answers())
        return found | ({"warnings": [*self.warnings, *warnings]} if warnings else {})

    @abstractmethod
    def answers(self) -> Sequence[AnyTrajectory]:
        """The answer of each plant, the leading one first."""

    def sample_times(self) -> Vector:
        """Equidistant times, and every switching instant twice: its left and its right value."""
        times = np.linspace(*self.span, self.spec.output.samples)
        switched = [time for found in self.switching.values() for time in found["times"]]
        switches = np.unique([*self.jumps(), *switched])
        # A sample that is a switching time but for rounding would stand beside it with the wrong value.
        gap = np.abs(times[:, None] - switches).min(axis=1, initial=np.inf)
        apart = gap > _ROUNDING * (self.span[1] - self.span[0])
        apart[[0, -1]] = True
        return np.sort(np.concatenate([times[apart], np.repeat(switches, 2)]))

    def jumps(self) -> Sequence[float]:
        """Further instants at which something jumps."""
        return ()


@dataclass(frozen=True, kw_only=True)
class Solution(Answer):
    """A trajectory with its proof."""

    problem: OptimalControlProblem
    trajectory: Trajectory
    costates: Vector
    """(n, K) at the nodes of the trajectory, dJ*/dx of every state; NaN where a method has none."""
    plants: Sequence[PlantAnswer] = ()
    """All plants under one command, the one of this result first; none without scenarios."""

    @property
    def span(self) -> tuple[float, float]:
        """Initial and final time."""
        return self.trajectory.t0, self.trajectory.tf

    def curves(self, times: Vector) -> dict[str, Any]:
        """See :meth:`Answer.curves`."""
        trajectory = self.trajectory
        sampled = sample(self.problem, trajectory, times)
        phase = {
            "name": "phase",
            "t0": trajectory.t0,
            "tf": trajectory.tf,
            "start": 0,
            "stop": len(sampled["t"]) - 1,
        }
        return {
            "coefficients": encode(trajectory.basis, trajectory.states, trajectory.controls),
            "nodes": nodes_of(trajectory, self.costates),
            "trajectory": sampled,
            "outputs": output_extremes(self.problem, trajectory, sampled),
            "design": dict(trajectory.design),
            "interpolation": interpolation_of(self.problem, trajectory),
            "phases": [phase],
        }

    def asked_for(self) -> dict[str, Any]:
        """See :meth:`Answer.asked_for`; besides, every plant."""
        found = super().asked_for()
        if self.plants:
            found["scenarios"] = {answer.plant.name: self._scenario(answer) for answer in self.plants}
        return found

    def answers(self) -> Sequence[AnyTrajectory]:
        """See :meth:`Answer.answers`."""
        return [answer.trajectory for answer in self.plants] or [self.trajectory]

    def _scenario(self, answer: PlantAnswer) -> dict[str, Any]:
        """The entry of one of several plants."""
        problem, trajectory = answer.plant.problem, answer.trajectory
        sampled = sample(problem, trajectory, self.sample_times())
        return {
            "trajectory": sampled,
            "verification": answer.verification.to_dict(),
            "outputs": output_extremes(problem, trajectory, sampled),
            "constraints": constraint_margins(
                problem,
                trajectory,
                answer.verification.integrals,
                lambda it: place_in_document(self.spec.problem, f"{it}@{answer.plant.name}"),
            ),
        }


def nodes_of(trajectory: Trajectory, costates: Vector) -> dict[str, Any]:
    """The ``nodes`` of a result, with the costates (n, K) there."""
    return {
        **trajectory.sample(trajectory.time(trajectory.nodes)),
        "costates": dict(zip(trajectory.states, costates.tolist(), strict=True)),
    }


def interpolation_of(problem: OptimalControlProblem, trajectory: Trajectory) -> dict[str, str]:
    """The ``interpolation`` of a result: how each control is to be read between nodes."""
    return {
        **dict.fromkeys(problem.rated, trajectory.interpolation),
        **{name: trajectory.interpolation_of(name) for name in trajectory.controls},
    }


@cache
def provenance() -> dict[str, Any]:
    """What computed a result."""
    return {
        "versions": {name: version(name) for name in ("ondelette", "casadi", "numpy", "scipy")}
        | {"python": platform.python_version()},
        "linear_solver": "mumps",
        "platform": platform.platform(),
    }


def finite(value: Any) -> Any:
    """A JSON value with None for every number that is not finite."""
    # Asked first by type: to ask whether something is a Mapping takes long.
    kind = type(value)
    if kind is float:
        return value if math.isfinite(value) else None
    if kind is str or kind is bool or kind is int or value is None:
        return value
    if kind is list or isinstance(value, list | tuple):
        # Most lists are the numbers of a history.
        if set(map(type, value)) == _ONLY_FLOATS and all(map(math.isfinite, value)):
            return [*value]
        return [finite(item) for item in value]
    if kind is dict or isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    # Of a class derived from float, as NumPy's.
    return None if isinstance(value, float) and not math.isfinite(value) else value
