"""A trajectory as numbers: states, controls and outputs at given times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.formulation.scenarios import formulate
from solvers.phases.reading import phased_problem
from solvers.phases.trajectory import AnyTrajectory, PhasedTrajectory, joined
from solvers.problem import OptimalControlProblem
from solvers.spec import check_document
from solvers.trajectory import Trajectory
from solvers.verification.violations import dense

Vector = NDArray[np.float64]


def sample(
    problem: OptimalControlProblem, trajectory: Trajectory, times: Vector, *, derivatives: bool = False
) -> dict[str, Any]:
    """The ``trajectory`` of a result at these times: that of the curves, rated controls, and ``outputs``."""
    outputs = problem.outputs_at(trajectory, trajectory.one_sided(times)) if problem.outputs else {}
    sampled = trajectory.sample(times, derivatives=derivatives)
    # Controls whose rates are chosen are states of the problem, but controls of the document.
    rated = {name: sampled["states"][name] for name in problem.rated}
    return {
        **sampled,
        "controls": {**rated, **sampled["controls"]},
        "outputs": {name: values.tolist() for name, values in outputs.items()},
    }


def sample_phases(
    problems: Sequence[OptimalControlProblem],
    answer: PhasedTrajectory,
    times: Vector,
    *,
    derivatives: bool = False,
) -> list[dict[str, Any]]:
    """The samples of each phase at those of these times that are its own; see :func:`sample`."""
    return answer.by_phase(
        times, lambda k, own: sample(problems[k], answer.parts[k], own, derivatives=derivatives)
    )


def resample(
    result: Mapping[str, Any],
    curves: AnyTrajectory,
    times: Vector,
    *,
    derivatives: bool = False,
) -> dict[str, Any]:
    """The ``trajectory`` of a stored result, whose ``curves`` these are, at other times."""
    return sample_any(problems_of(result), curves, times, derivatives=derivatives)


def sample_any(
    problems: Sequence[OptimalControlProblem],
    curves: AnyTrajectory,
    times: Vector,
    *,
    derivatives: bool = False,
) -> dict[str, Any]:
    """The samples of any answer at times in any order, with the problem of each of its phases."""
    if isinstance(curves, Trajectory):
        return sample(problems[0], curves, times, derivatives=derivatives)
    # Phase by phase, then back into the order that was asked for.
    order = np.argsort(curves.owners(times), kind="stable")
    whole = joined(sample_phases(problems, curves, times, derivatives=derivatives))
    places = np.argsort(order).tolist()
    groups = {
        key: {name: [values[place] for place in places] for name, values in group.items()}
        for key, group in whole.items()
        if key != "t"
    }
    return {"t": [whole["t"][place] for place in places], **groups}


def problems_of(result: Mapping[str, Any]) -> list[OptimalControlProblem]:
    """The problem of each phase of a stored result, the only one where it has no phases."""
    spec = check_document(result["resolved"]["document"]).problem
    if spec.phases:
        return [phase.plant.problem for phase in phased_problem(spec).phases]
    return [problem_of(result)]


def problem_of(result: Mapping[str, Any]) -> OptimalControlProblem:
    """The problem that the trajectory of a stored result answers: of several plants that of the first."""
    return formulate(check_document(result["resolved"]["document"]).problem).plants[0].problem


def output_extremes(
    problem: OptimalControlProblem, trajectory: Trajectory, sampled: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """The ``outputs`` of a result: smallest and largest value of each, and when.

    Looked for between the breakpoints of the trajectory and among what was ``sampled`` for the result.
    """
    if not problem.outputs:
        return []
    tau = dense(trajectory.breakpoints)
    times = np.concatenate([trajectory.time(tau), sampled["t"]])
    units = {item.name: item.units for item in problem.outputs}
    return [
        {
            "name": name,
            "units": units[name],
            **_extremes(np.concatenate([values, sampled["outputs"][name]]), times),
        }
        for name, values in problem.outputs_at(trajectory, tau).items()
    ]


def _extremes(values: Vector, times: Vector) -> dict[str, float | None]:
    found: dict[str, float | None] = dict.fromkeys(("min", "min_at", "max", "max_at"))
    if np.isfinite(values).any():
        for key, index in (("min", np.nanargmin(values)), ("max", np.nanargmax(values))):
            found |= {key: float(values[index]), f"{key}_at": float(times[index])}
    return found
