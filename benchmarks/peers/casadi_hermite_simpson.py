"""Hermite-Simpson as one writes it by hand with CasADi: an MX graph, expanded, solved by IPOPT."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
from contract import Answer, run
from problems import MAX_ITERATIONS, TOLERANCE, Case


def build(case: Case, points: int, variant: str) -> Callable[[], Answer]:
    """Separated form: states and controls at both ends and the middle of each interval."""
    n, m, intervals = len(case.states), len(case.controls), (points - 1) // 2
    count = 2 * intervals + 1
    x, u = ca.MX.sym("x", n), ca.MX.sym("u", m)
    rates = ca.vertcat(*case.rates(ca.vertsplit(x), ca.vertsplit(u), ca))
    running = case.running(ca.vertsplit(x), ca.vertsplit(u), ca)
    f = ca.Function("f", [x, u], [rates, 0 if running is None else running]).map(count)
    states, controls, duration = ca.MX.sym("X", n, count), ca.MX.sym("U", m, count), ca.MX.sym("T")
    slopes, costs = f(states, controls)
    h = duration / intervals
    left, middle, right = slice(0, count - 2, 2), slice(1, count - 1, 2), slice(2, count, 2)
    hermite = (
        states[:, middle]
        - (states[:, left] + states[:, right]) / 2
        - h / 8 * (slopes[:, left] - slopes[:, right])
    )
    simpson = (
        states[:, right]
        - states[:, left]
        - h / 6 * (slopes[:, left] + 4 * slopes[:, middle] + slopes[:, right])
    )
    objective = h / 6 * ca.sum2(costs[:, left] + 4 * costs[:, middle] + costs[:, right])
    terminal = case.terminal(ca.vertsplit(states[:, -1]), duration, ca)
    program = {
        "x": ca.vertcat(ca.vec(states), ca.vec(controls), duration),
        "f": objective if terminal is None else objective + terminal,
        "g": ca.vertcat(ca.vec(hermite), ca.vec(simpson)),
    }
    options = {
        "expand": True,
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": TOLERANCE,
        "ipopt.max_iter": MAX_ITERATIONS,
    }
    solver = ca.nlpsol("hand_written", "ipopt", program, options)
    names = (*case.states, *case.controls)
    lower, upper = (np.array([[case.bounds[name][side]] * count for name in names]) for side in (0, 1))
    for i, name in enumerate(case.states):
        for end, values in ((0, case.initial), (-1, case.final)):
            if name in values:
                lower[i, end] = upper[i, end] = values[name]
    guess = np.array([[case.guess(name, tau) for tau in np.linspace(0, 1, count)] for name in names])

    def packed(values: np.ndarray, time: float) -> np.ndarray:
        return np.concatenate([values[:n].T.ravel(), values[n:].T.ravel(), [time]])

    def again() -> Answer:
        result = solver(
            x0=packed(guess, case.guess_time),
            lbx=packed(lower, case.final_time[0]),
            ubx=packed(upper, case.final_time[1]),
            lbg=0,
            ubg=0,
        )
        values = np.asarray(result["x"]).ravel()
        times = np.linspace(0, values[-1], count).tolist()
        trajectory, steering = values[: n * count].reshape(count, n), values[n * count : -1].reshape(count, m)
        return Answer(
            objective=float(result["f"]),
            times=times,
            controls=dict(zip(case.controls, steering.T.tolist(), strict=True)),
            state_times=times,
            states=dict(zip(case.states, trajectory.T.tolist(), strict=True)),
            success=bool(solver.stats()["success"]),
            message=solver.stats()["return_status"],
            mesh=f"{intervals} intervals",
        )

    return again


if __name__ == "__main__":
    run("CasADi by hand", ca.__version__, build)
