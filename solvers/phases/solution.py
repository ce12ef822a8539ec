"""The answer to a flight of phases, and the result JSON that it becomes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.coefficients import encode
from solvers.output.sampling import output_extremes, sample_phases
from solvers.phases.problem import PhasedProblem
from solvers.phases.scenarios import FlightPlant
from solvers.phases.trajectory import PhasedTrajectory, joined
from solvers.problem import OptimalControlProblem
from solvers.solution import Answer, interpolation_of, nodes_of
from solvers.verification.verdict import Verification

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class FlightAnswer:
    """One of the plants under a command: its part of the answer, and what its flight showed."""

    plant: FlightPlant
    trajectory: PhasedTrajectory
    verification: Verification
    constraints: Sequence[Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True)
class PhasedSolution(Answer):
    """A trajectory of several phases with its proof; ``costates``, ``model_reports`` and so on by phase."""

    problem: PhasedProblem
    trajectory: PhasedTrajectory
    costates: Sequence[Vector]
    model_reports: Sequence[Mapping[str, Any] | None]
    integrals_by_phase: Sequence[Mapping[str, float]]
    plants: Sequence[FlightAnswer] = ()
    """All plants under one command, the one of this result first; none without scenarios."""

    @property
    def span(self) -> tuple[float, float]:
        """Initial and final time."""
        return self.trajectory.t0, self.trajectory.tf

    def answers(self) -> Sequence[PhasedTrajectory]:
        """See :meth:`solvers.solution.Answer.answers`."""
        return [answer.trajectory for answer in self.plants] or [self.trajectory]

    def asked_for(self) -> dict[str, Any]:
        """See :meth:`Answer.asked_for`; besides, every plant."""
        found = super().asked_for()
        if self.plants:
            found["scenarios"] = {answer.plant.name: self._scenario(answer) for answer in self.plants}
        return found

    def _scenario(self, answer: FlightAnswer) -> dict[str, Any]:
        """The entry of one of several plants."""
        samples, outputs = _sampled(answer.plant.problem, answer.trajectory, self.sample_times())
        return {
            "trajectory": joined(samples),
            "verification": answer.verification.to_dict(),
            "outputs": outputs,
            "constraints": list(answer.constraints),
        }

    def jumps(self) -> Sequence[float]:
        """Where phases meet."""
        return list(self.trajectory.edges[1:-1])

    def curves(self, times: Vector) -> dict[str, Any]:
        """See :meth:`solvers.solution.Answer.curves`."""
        answer, problems = self.trajectory, _problems(self.problem)
        pairs = list(zip(problems, answer.parts, strict=True))
        samples, outputs = _sampled(self.problem, answer, times)
        nodes = [nodes_of(part, own) for part, own in zip(answer.parts, self.costates, strict=True)]
        parts = [encode(part.basis, part.states, part.controls) for part in answer.parts]
        return {
            "coefficients": {"basis": {"name": "phases"}, "states": {}, "controls": {}, "phases": parts},
            "nodes": joined(nodes),
            "trajectory": joined(samples),
            "outputs": outputs,
            "design": answer.design,
            "interpolation": {
                name: how for problem, part in pairs for name, how in interpolation_of(problem, part).items()
            },
            "phases": self._phases(samples, nodes),
        }

    def _phases(
        self, samples: Sequence[Mapping[str, Any]], nodes: Sequence[Mapping[str, Any]]
    ) -> list[dict[str, Any]]:
        """The ``phases`` of a result: where each is in time, and in the lists of trajectory and nodes."""
        found, first, first_node = [], 0, 0
        for index, (phase, part) in enumerate(zip(self.problem.phases, self.trajectory.parts, strict=True)):
            stop, stop_node = first + len(samples[index]["t"]), first_node + len(nodes[index]["t"])
            found.append(
                {
                    "name": phase.name,
                    "t0": part.t0,
                    "tf": part.tf,
                    "start": first,
                    "stop": stop - 1,
                    "nodes": [first_node, stop_node - 1],
                    "states": list(part.states),
                    "controls": list(part.controls),
                    "design": dict(part.design),
                    "integrals": dict(self.integrals_by_phase[index]),
                    "model_report": self.model_reports[index],
                    "verification": self.verification.parts[index].to_dict(),
                }
            )
            first, first_node = stop, stop_node
        return found


def _problems(problem: PhasedProblem) -> list[OptimalControlProblem]:
    return [phase.plant.problem for phase in problem.phases]


def _sampled(
    problem: PhasedProblem, answer: PhasedTrajectory, times: Vector
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The samples of each phase at these times, and the ``outputs`` of a result."""
    problems = _problems(problem)
    samples = sample_phases(problems, answer, times)
    extremes = [
        item
        for alone, part, own in zip(problems, answer.parts, samples, strict=True)
        if own["t"]
        for item in output_extremes(alone, part, own)
    ]
    return samples, _extremes_of_all(extremes)


def _extremes_of_all(items: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The ``outputs`` of a result, those of one name in several phases together."""
    found: dict[str, dict[str, Any]] = {}
    for item in items:
        known = found.setdefault(item["name"], dict(item))
        for side, better in (("min", np.less), ("max", np.greater)):
            if item[side] is not None and (known[side] is None or better(item[side], known[side])):
                known |= {side: item[side], f"{side}_at": item[f"{side}_at"]}
    return list(found.values())
