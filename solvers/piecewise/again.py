"""A stored mission verified again: the result holds all that is needed."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from solvers.formulation.stated import stated_problem
from solvers.piecewise.pieces import Pieces
from solvers.piecewise.plant import Plant
from solvers.piecewise.stop import StopWatch
from solvers.piecewise.verify import verify_mission
from solvers.problem import OptimalControlProblem
from solvers.spec import PiecewiseMethod, ProblemSpec
from solvers.trajectory import Trajectory
from solvers.verification.verdict import Tolerances, Verification


def verify_again(
    spec: ProblemSpec,
    method: PiecewiseMethod,
    result: Mapping[str, Any],
    trajectory: Trajectory,
    tolerances: Tolerances,
    seconds: float,
) -> Verification:
    """Integrate the pieces of a stored mission again, and look for its stop anew.

    Raises KeyError, ValueError or TypeError where the result is not one of a mission.
    """
    problem = stated_problem(spec)
    plant = Plant.of(spec, method.plant, problem)
    flown, names = result["plant"], plant.equations.held_names
    states = np.array([flown["states"][name] for name in plant.equations.states], np.float64)
    count = states.shape[1] - 1
    held = np.array([flown["held"][name] for name in names], np.float64).reshape(len(names), count)
    ends = np.array(
        [np.reshape(result["coefficients"]["controls"][name], (-1, 2))[:count] for name in problem.controls]
    ).reshape(-1, count, 2)
    times = np.array(result["nodes"]["t"][: count + 1], np.float64)
    seen = np.array([result["nodes"]["states"][name][: count + 1] for name in problem.states])
    pieces = Pieces(times, states.T, seen, np.zeros(count + 1), ends[:, :, 0].T, ends[:, :, 1].T, held.T)
    return verify_mission(
        plant,
        method,
        pieces,
        trajectory,
        tolerances,
        stop=_stopped(problem, method, result),
        deadline=time.monotonic() + seconds,
    )


def _stopped(
    problem: OptimalControlProblem, method: PiecewiseMethod, result: Mapping[str, Any]
) -> bool | None:
    """Whether the mission's segments come to the document's stop; None if it has none."""
    if method.stop is None:
        return None
    watch = StopWatch.of(problem, method)
    return any(
        watch.met(
            np.array(segment["tracked"]["t"]),
            np.array([segment["tracked"]["states"][name] for name in problem.states]),
            np.array([segment["tracked"]["controls"][name] for name in problem.controls]),
        )
        is not None
        for segment in result["segments"]
    )
