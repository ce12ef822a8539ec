"""GEKKO on this machine (remote=False): its mode 6, three collocation nodes a step, IPOPT inside its program.

The final time is a factor of the rates. End conditions are GEKKO's fix_final, or, variant "inequalities", two
inequalities that hold over the last step, inner nodes included, where fix_final finds no solution.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version

import numpy as np
from contract import Answer, held, run
from gekko import GEKKO
from problems import MAX_ITERATIONS, TOLERANCE, Case

NODES = 3


def build(case: Case, points: int, variant: str) -> Callable[[], Answer]:
    """N time points; controls are constant over each step, as GEKKO's manipulated variables are."""

    def again() -> Answer:
        model = GEKKO(remote=False)
        model.time = np.linspace(0, 1, points)
        fractions = model.time
        duration = (
            model.FV(value=case.guess_time, lb=case.final_time[0], ub=case.final_time[1])
            if case.free_time
            else model.Param(value=case.final_time[0])
        )
        if case.free_time:
            duration.STATUS = 1

        def bounds(name: str) -> dict[str, float]:
            low, high = case.bounds[name]
            return ({"lb": low} if np.isfinite(low) else {}) | ({"ub": high} if np.isfinite(high) else {})

        states = [
            model.Var(value=[case.guess(name, tau) for tau in fractions], **bounds(name))
            for name in case.states
        ]
        controls = [
            model.MV(value=[case.guess(name, tau) for tau in fractions], **bounds(name))
            for name in case.controls
        ]
        for control in controls:
            control.STATUS = 1
            control.DCOST = 0
            # Else the guess is kept over the first step, which costs 0.2 s on the slew.
            model.free_initial(control)
        last = model.Param(value=np.append(np.zeros(points - 1), 1.0))
        for state, rate in zip(states, case.rates(states, controls, model), strict=True):
            model.Equation(state.dt() == duration * rate)
        for name, state in zip(case.states, states, strict=True):
            if name not in case.final:
                continue
            if variant == "inequalities":
                model.Equation(last * (state - case.final[name]) <= 0)
                model.Equation(last * (state - case.final[name]) >= 0)
            else:
                model.fix_final(state, val=case.final[name])
        running = case.running(states, controls, model)
        if running is None:
            model.Minimize(case.terminal(states, duration, model) * last)
        else:
            cost = model.Var(value=0)
            model.Equation(cost.dt() == duration * running)
            model.Minimize(cost * last)
        model.options.IMODE = 6
        model.options.NODES = NODES
        model.options.SOLVER = 3
        model.options.RTOL = model.options.OTOL = TOLERANCE
        model.options.MAX_ITER = MAX_ITERATIONS
        model.solve(disp=False)
        final_time = float(duration.value[0])
        times = (fractions * final_time).tolist()
        # A manipulated variable's value at a point acts over the step that starts there.
        flown = {
            name: held(times, list(control.value)[:-1])
            for name, control in zip(case.controls, controls, strict=True)
        }
        return Answer(
            objective=float(model.options.OBJFCNVAL),
            times=next(iter(flown.values()))[0],
            controls={name: values for name, (_, values) in flown.items()},
            state_times=times,
            states={
                name: [float(v) for v in state.value] for name, state in zip(case.states, states, strict=True)
            },
            success=model.options.APPSTATUS == 1,
            message=f"APPSTATUS {model.options.APPSTATUS}",
            mesh=f"{points - 1} constant controls, {NODES} nodes a step",
        )

    return again


if __name__ == "__main__":
    run("GEKKO", version("gekko"), build)
