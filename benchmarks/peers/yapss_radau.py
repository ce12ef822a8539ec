"""YAPSS: Legendre-Gauss-Radau collocation in segments of five points, derivatives by its CasADi layer."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version

import numpy as np
from contract import Answer, run, through_the_ends
from problems import MAX_ITERATIONS, TOLERANCE, Case
from yapss import ContinuousArg, ObjectiveArg, Problem
from yapss import math as functions

DEGREE = 5


def build(case: Case, points: int, variant: str) -> Callable[[], Answer]:
    """One phase; a running cost is its one integral."""
    segments = round(points / DEGREE)
    integrals = int("running" in case.objective)
    problem = Problem(name=case.name, nx=[len(case.states)], nu=[len(case.controls)], nq=[integrals])

    def objective(arg: ObjectiveArg) -> None:
        phase = arg.phase[0]
        terminal = case.terminal(list(phase.final_state), phase.final_time, functions)
        arg.objective = phase.integral[0] if terminal is None else terminal

    def continuous(arg: ContinuousArg) -> None:
        phase = arg.phase[0]
        phase.dynamics[:] = case.rates(list(phase.state), list(phase.control), functions)
        if integrals:
            phase.integrand[:] = (case.running(list(phase.state), list(phase.control), functions),)

    problem.functions.objective = objective
    problem.functions.continuous = continuous
    bounds = problem.bounds.phase[0]
    bounds.initial_time.lower = bounds.initial_time.upper = 0
    bounds.final_time.lower, bounds.final_time.upper = case.final_time
    for i, name in enumerate(case.states):
        bounds.state.lower[i], bounds.state.upper[i] = case.bounds[name]
        for end, values in ((bounds.initial_state, case.initial), (bounds.final_state, case.final)):
            if name in values:
                end.lower[i] = end.upper[i] = values[name]
    for j, name in enumerate(case.controls):
        bounds.control.lower[j], bounds.control.upper[j] = case.bounds[name]
    knots = np.linspace(0, 1, 61)
    guess = problem.guess.phase[0]
    guess.time = knots * case.guess_time
    guess.state = [[case.guess(name, tau) for tau in knots] for name in case.states]
    guess.control = [[case.guess(name, tau) for tau in knots] for name in case.controls]
    problem.mesh.phase[0].collocation_points = segments * [DEGREE]
    problem.mesh.phase[0].fraction = segments * [1 / segments]
    problem.spectral_method = "lgr"
    problem.derivatives.method = "auto"
    problem.derivatives.order = "second"
    problem.ipopt_options.tol = TOLERANCE
    problem.ipopt_options.max_iter = MAX_ITERATIONS
    problem.ipopt_options.print_level = 0

    def again() -> Answer:
        solution = problem.solve()
        phase = solution.phase[0]
        ends = phase.initial_time, phase.final_time
        controls = {
            name: through_the_ends(phase.time_c, phase.control[j], *ends)
            for j, name in enumerate(case.controls)
        }
        return Answer(
            objective=float(solution.objective),
            times=next(iter(controls.values()))[0],
            controls={name: values for name, (_, values) in controls.items()},
            state_times=[float(t) for t in phase.time],
            states={name: [float(v) for v in phase.state[i]] for i, name in enumerate(case.states)},
            success=solution.nlp_info.ipopt_status == 0,
            message=solution.nlp_info.ipopt_status_message,
            mesh=f"LGR {segments} x {DEGREE}",
        )

    return again


if __name__ == "__main__":
    run("YAPSS", version("yapss"), build)
