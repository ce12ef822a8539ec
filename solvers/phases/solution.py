"""The answer to a flight of phases, and the result JSON that it becomes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.coefficients import encode
from solvers.phases.problem import PhasedProblem
from solvers.phases.trajectory import PhasedTrajectory, joined
from solvers.sampling import output_extremes, sample_phases
from solvers.solution import Answer, interpolation_of, nodes_of

Vector = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PhasedSolution(Answer):
    """A trajectory of several phases with its proof; ``costates``, ``model_reports`` and so on by phase."""

    problem: PhasedProblem
    trajectory: PhasedTrajectory
    costates: Sequence[Vector]
    model_reports: Sequence[Mapping[str, Any] | None]
    integrals_by_phase: Sequence[Mapping[str, float]]

    @property
    def span(self) -> tuple[float, float]:
        """Initial and final time."""
        return self.trajectory.t0, self.trajectory.tf

    def answers(self) -> Sequence[PhasedTrajectory]:
        """See :meth:`solvers.solution.Answer.answers`."""
        return [self.trajectory]

    def jumps(self) -> Sequence[float]:
        """Where phases meet."""
        return list(self.trajectory.edges[1:-1])

    def curves(self, times: Vector) -> dict[str, Any]:
        """See :meth:`solvers.solution.Answer.curves`."""
        answer, problems = self.trajectory, [phase.plant.problem for phase in self.problem.phases]
        pairs = list(zip(problems, answer.parts, strict=True))
        samples = sample_phases(problems, answer, times)
        nodes = [nodes_of(part, own) for part, own in zip(answer.parts, self.costates, strict=True)]
        parts = [encode(part.basis, part.states, part.controls) for part in answer.parts]
        extremes = [
            output_extremes(problem, part, own)
            for (problem, part), own in zip(pairs, samples, strict=True)
            if own["t"]
        ]
        return {
            "coefficients": {"basis": {"name": "phases"}, "states": {}, "controls": {}, "phases": parts},
            "nodes": joined(nodes),
            "trajectory": joined(samples),
            "outputs": _extremes_of_all(item for own in extremes for item in own),
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


def _extremes_of_all(items: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The ``outputs`` of a result, those of one name in several phases together."""
    found: dict[str, dict[str, Any]] = {}
    for item in items:
        known = found.setdefault(item["name"], dict(item))
        for side, better in (("min", np.less), ("max", np.greater)):
            if item[side] is not None and (known[side] is None or better(item[side], known[side])):
                known |= {side: item[side], f"{side}_at": item[f"{side}_at"]}
    return list(found.values())
