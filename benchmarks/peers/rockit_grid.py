"""rockit: multiple shooting with Runge-Kutta steps, or variant "collocation": Radau points in each interval.

Its controls are constant over each control interval, so its answer is that of another, smaller set of
controls; they are flown as rockit means them, constant.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version

import casadi as ca
import numpy as np
from contract import Answer, held, run
from problems import MAX_ITERATIONS, TOLERANCE, Case
from rockit import DirectCollocation, FreeTime, MultipleShooting, Ocp

DEGREE = 4


def build(case: Case, points: int, variant: str) -> Callable[[], Answer]:
    """N - 1 control intervals."""
    ocp = Ocp(t0=0, T=FreeTime(case.guess_time) if case.free_time else case.final_time[0])
    states = {name: ocp.state() for name in case.states}
    controls = {name: ocp.control() for name in case.controls}
    rates = case.rates(list(states.values()), list(controls.values()), ca)
    for state, rate in zip(states.values(), rates, strict=True):
        ocp.set_der(state, rate)
    running = case.running(list(states.values()), list(controls.values()), ca)
    if running is not None:
        ocp.add_objective(ocp.integral(running))
    terminal = case.terminal([ocp.at_tf(state) for state in states.values()], ocp.T, ca)
    if terminal is not None:
        ocp.add_objective(terminal)
    if case.free_time:
        ocp.subject_to((case.final_time[0] <= ocp.T) <= case.final_time[1])
    for name, variable in (states | controls).items():
        lower, upper = case.bounds[name]
        if np.isfinite(lower) and np.isfinite(upper):
            ocp.subject_to(lower <= (variable <= upper))
        elif np.isfinite(lower):
            ocp.subject_to(variable >= lower)
        ocp.set_initial(variable, straight_lines(case.guesses[name], ocp.t / case.guess_time))
    for name, state in states.items():
        if name in case.initial:
            ocp.subject_to(ocp.at_t0(state) == case.initial[name])
        if name in case.final:
            ocp.subject_to(ocp.at_tf(state) == case.final[name])
    options = {
        "expand": True,
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": TOLERANCE,
        "ipopt.max_iter": MAX_ITERATIONS,
    }
    ocp.solver("ipopt", options)
    collocation = variant == "collocation"
    ocp.method(
        DirectCollocation(N=points - 1, M=1, degree=DEGREE)
        if collocation
        else MultipleShooting(N=points - 1, M=1, intg="rk")
    )

    def again() -> Answer:
        try:
            solution = ocp.solve()
            success = True
        except RuntimeError:
            solution, success = ocp.non_converged_solution, False
        times, objective = solution.sample(ocp.T, grid="control")[0], solution.value(ocp.objective)
        flown = {
            name: held(times, solution.sample(variable, grid="control")[1][:-1])
            for name, variable in controls.items()
        }
        return Answer(
            objective=float(objective),
            times=next(iter(flown.values()))[0],
            controls={name: values for name, (_, values) in flown.items()},
            state_times=[float(t) for t in times],
            states={
                name: solution.sample(state, grid="control")[1].tolist() for name, state in states.items()
            },
            success=success,
            message=solution.stats["return_status"],
            mesh=f"{points - 1} constant controls, " + (f"Radau degree {DEGREE}" if collocation else "RK4"),
        )

    return again


def straight_lines(values: list[float], fraction: ca.MX) -> ca.MX:
    """Straight lines through equally spaced values, as rockit wants a guess: an expression of time."""
    slopes = np.diff(values) * (len(values) - 1)
    bends = np.diff(slopes, prepend=0.0)
    return values[0] + sum(
        bend * ca.fmax(fraction - i / len(slopes), 0) for i, bend in enumerate(bends) if bend
    )


if __name__ == "__main__":
    run("rockit", version("rockit-meco"), build)
