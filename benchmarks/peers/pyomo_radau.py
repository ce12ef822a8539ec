"""Pyomo's pyomo.dae: Radau collocation in segments of five points on normalised time.

No package of the index brings the IPOPT program that Pyomo calls, so its model is written as an NL file, as
Pyomo does for any solver, and read and solved by CasADi's IPOPT; all of it counts as Pyomo's time.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pyomo.environ as pyo
from contract import Answer, run, through_the_ends
from problems import MAX_ITERATIONS, TOLERANCE, Case
from pyomo import dae
from pyomo.version import version_info

DEGREE = 5


def build(case: Case, points: int, variant: str) -> Callable[[], Answer]:
    """The final time is a variable that multiplies the rates, as pyomo.dae needs it."""
    segments = round(points / DEGREE)
    model = pyo.ConcreteModel()
    model.tau = dae.ContinuousSet(bounds=(0, 1))
    lower, upper = case.final_time
    model.duration = pyo.Var(bounds=(lower, upper))
    if not case.free_time:
        model.duration.fix(lower)
    variables = {}
    for name in (*case.states, *case.controls):
        low, high = (value if np.isfinite(value) else None for value in case.bounds[name])
        variables[name] = pyo.Var(model.tau, bounds=(low, high))
        model.add_component(name, variables[name])
    for name in case.states:
        model.add_component(f"{name}_rate", dae.DerivativeVar(variables[name], wrt=model.tau))

    def at(names: tuple[str, ...], tau: float) -> list[object]:
        return [variables[name][tau] for name in names]

    def dynamics(i: int) -> Callable[[pyo.ConcreteModel, float], object]:
        def rule(block: pyo.ConcreteModel, tau: float) -> object:
            if tau == 0:
                return pyo.Constraint.Skip
            rate = case.rates(at(case.states, tau), at(case.controls, tau), pyo)[i]
            return block.component(f"{case.states[i]}_rate")[tau] == block.duration * rate

        return rule

    for i, name in enumerate(case.states):
        model.add_component(f"{name}_dynamics", pyo.Constraint(model.tau, rule=dynamics(i)))
    if "running" in case.objective:
        model.cost = pyo.Var(model.tau, initialize=0)
        model.cost_rate = dae.DerivativeVar(model.cost, wrt=model.tau)
        model.cost_dynamics = pyo.Constraint(
            model.tau,
            rule=lambda block, tau: (
                pyo.Constraint.Skip
                if tau == 0
                else block.cost_rate[tau]
                == block.duration * case.running(at(case.states, tau), at(case.controls, tau), pyo)
            ),
        )
        model.cost[0].fix(0)
    for tau, values in ((0, case.initial), (1, case.final)):
        for name, value in values.items():
            variables[name][tau].fix(value)
    pyo.TransformationFactory("dae.collocation").apply_to(
        model, nfe=segments, ncp=DEGREE, scheme="LAGRANGE-RADAU"
    )

    def again() -> Answer:
        for variable in model.component_data_objects(pyo.Var):
            if not variable.fixed:
                variable.value = None
        if case.free_time:
            model.duration.value = case.guess_time
        for name, variable in variables.items():
            for tau in model.tau:
                if not variable[tau].fixed:
                    variable[tau].value = case.guess(name, tau)
        terminal = case.terminal(at(case.states, 1), model.duration, pyo)
        model.objective = pyo.Objective(expr=model.cost[1] if terminal is None else terminal)
        status = ipopt(model)
        taus = sorted(model.tau)
        duration = pyo.value(model.duration)
        # At tau = 0 Radau's points do not use the control, so that it keeps its guess there.
        clocks = {
            name: through_the_ends(
                [tau * duration for tau in taus[1:]],
                [pyo.value(variables[name][tau]) for tau in taus[1:]],
                0.0,
                duration,
            )
            for name in case.controls
        }
        return Answer(
            objective=pyo.value(model.objective),
            times=next(iter(clocks.values()))[0],
            controls={name: values for name, (_, values) in clocks.items()},
            state_times=[tau * duration for tau in taus],
            states={name: [pyo.value(variables[name][tau]) for tau in taus] for name in case.states},
            success=status == "Solve_Succeeded",
            message=status,
            mesh=f"LGR {segments} x {DEGREE}",
        )

    return again


def ipopt(model: pyo.ConcreteModel) -> str:
    """Solve by an NL file and CasADi's IPOPT, put the values into the model, return IPOPT's word."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.nl"
        _, key = model.write(str(path), format="nl")
        builder = ca.NlpBuilder()
        builder.import_nl(str(path))
    options = {
        "expand": True,
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": TOLERANCE,
        "ipopt.max_iter": MAX_ITERATIONS,
    }
    program = {"x": ca.vertcat(*builder.x), "f": builder.f, "g": ca.vertcat(*builder.g)}
    solver = ca.nlpsol("pyomo", "ipopt", program, options)
    bounds = {"lbx": builder.x_lb, "ubx": builder.x_ub, "lbg": builder.g_lb, "ubg": builder.g_ub}
    values = np.asarray(solver(x0=builder.x_init, **bounds)["x"]).ravel()
    symbols = model.solutions.symbol_map[key].bySymbol
    for index, value in enumerate(values):
        symbols[f"v{index}"].value = float(value)
    return solver.stats()["return_status"]


if __name__ == "__main__":
    run("pyomo.dae", ".".join(map(str, version_info[:3])), build)
