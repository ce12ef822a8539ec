"""opty: midpoint collocation on N nodes, derived with SymPy, compiled with Cython, solved by cyipopt.

opty passes IPOPT no second derivatives, so IPOPT builds them up from the first (L-BFGS). The cold time holds
the C compiler's; the compiled problem is kept for the warm one.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import opty
import sympy as sm
from contract import Answer, run
from problems import FUNCTIONS, MAX_ITERATIONS, TOLERANCE, Case
from sympy.physics.mechanics import dynamicsymbols

SYMBOLIC = SimpleNamespace(**{name: getattr(sm, name) for name in FUNCTIONS})


def build(case: Case, points: int, variant: str) -> Callable[[], Answer]:
    """The time between nodes is an unknown where the final time is free."""
    time = dynamicsymbols._t
    states = [dynamicsymbols(name) for name in case.states]
    controls = [dynamicsymbols(name) for name in case.controls]
    rates = case.rates(states, controls, SYMBOLIC)
    equations = sm.Matrix([state.diff(time) - rate for state, rate in zip(states, rates, strict=True)])
    h = sm.Symbol("h") if case.free_time else case.final_time[0] / (points - 1)
    # opty names the instants of its conditions; with a free step they are multiples of it.
    last = (points - 1) * h if case.free_time else case.final_time[0]
    start = 0 * h if case.free_time else 0.0
    conditions = tuple(
        state.subs(time, instant) - values[name]
        for instant, values in ((start, case.initial), (last, case.final))
        for name, state in zip(case.states, states, strict=True)
        if name in values
    )
    bounds = {
        variable: tuple(float(np.clip(value, -1e19, 1e19)) for value in case.bounds[name])
        for name, variable in zip((*case.states, *case.controls), (*states, *controls), strict=True)
    }
    if case.free_time:
        bounds[h] = tuple(value / (points - 1) for value in case.final_time)
    objective, gradient = costs(case, states, controls, points, h)
    problem = opty.Problem(
        objective,
        gradient,
        equations,
        states,
        points,
        h,
        instance_constraints=conditions,
        time_symbol=time,
        integration_method="midpoint",
        bounds=bounds,
        backend="cython",
    )
    problem.add_option("tol", TOLERANCE)
    problem.add_option("max_iter", MAX_ITERATIONS)
    problem.add_option("print_level", 0)
    fractions = np.linspace(0, 1, points)
    guess = [case.guess(name, tau) for name in (*case.states, *case.controls) for tau in fractions]
    if case.free_time:
        guess.append(case.guess_time / (points - 1))

    def again() -> Answer:
        values, info = problem.solve(np.array(guess))
        duration = float(values[-1]) * (points - 1) if case.free_time else case.final_time[0]
        rows = values[: points * (len(states) + len(controls))].reshape(-1, points).tolist()
        times = (fractions * duration).tolist()
        return Answer(
            objective=float(info["obj_val"]),
            times=times,
            controls=dict(zip(case.controls, rows[len(states) :], strict=True)),
            state_times=times,
            states=dict(zip(case.states, rows[: len(states)], strict=True)),
            success=info["status"] == 0,
            message=info["status_msg"].decode(),
            mesh=f"midpoint, {points} nodes",
        )

    return again


def costs(case: Case, states: list, controls: list, points: int, h: object) -> tuple:
    """The objective and its gradient as functions of all unknowns."""
    if "running" in case.objective:
        integral = sm.Integral(case.running(states, controls, SYMBOLIC), dynamicsymbols._t)
        return opty.create_objective_function(
            integral, states, controls, (), points, h, integration_method="midpoint"
        )
    final = sm.symbols(f"x:{len(states)}")
    final_time = sm.Symbol("t_f")
    expression = sm.sympify(case.terminal(final, final_time, SYMBOLIC))
    value = sm.lambdify((final, final_time), expression)
    slopes = sm.lambdify((final, final_time), [expression.diff(symbol) for symbol in (*final, final_time)])
    places = [points * (i + 1) - 1 for i in range(len(states))]

    def objective(free: np.ndarray) -> float:
        return value(free[places], free[-1] * (points - 1))

    def gradient(free: np.ndarray) -> np.ndarray:
        result = np.zeros_like(free)
        *by_state, by_time = slopes(free[places], free[-1] * (points - 1))
        result[places] = by_state
        result[-1] += by_time * (points - 1)
        return result

    return objective, gradient


if __name__ == "__main__":
    run("opty", opty.__version__, build)
